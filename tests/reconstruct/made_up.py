"""Small prepared objects and small rendered captures of them."""

from __future__ import annotations

from pathlib import Path

from pipeline.records.objects import PreparedObject
from pipeline.records.parameters import read_parameters
from pipeline.records.parameters.capture import RenderingParameters
from pipeline.records.parameters.reconstruct import ReconstructParameters
from tests.objects import prepared

PLACES = {
    "block": {"position": (-0.07, -0.04), "yaw_degrees": 20.0},
    "can": {"position": (0.06, 0.04), "yaw_degrees": 0.0},
}


def shapes() -> dict[str, PreparedObject]:
    """A block and a can, both 6 cm wide."""
    import trimesh

    return {
        "block": prepared("block", trimesh.creation.box((0.06, 0.05, 0.05))),
        "can": prepared("can", trimesh.creation.cylinder(radius=0.03, height=0.08, sections=96)),
    }


def settings(**changes) -> RenderingParameters:
    """A quick capture: 16 views of 480 x 360 pixels."""
    base = {"objects": PLACES, "views": 16, "width": 480, "height": 360}
    return RenderingParameters.model_validate({**base, **changes})


def quick() -> ReconstructParameters:
    """Fewer features and planes and a coarser octree do for small photos."""
    settings = read_parameters().reconstruct
    return settings.model_copy(
        update={
            "sparse": settings.sparse.model_copy(update={"features": 1024}),
            "sweep": settings.sweep.model_copy(update={"planes": 32}),
            "surface": settings.surface.model_copy(update={"poisson_depth": 6}),
        }
    )


def rendered(folder: Path, seed: int = 1, **changes) -> Path:
    """Render a capture of the shapes into ``folder``."""
    from pipeline.capture.recipe import render_capture

    render_capture(folder, "made_up", shapes(), settings(**changes), seed, workers=1)
    return folder
