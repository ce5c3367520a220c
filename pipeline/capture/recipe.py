"""A rendered capture: exactly the folder that a person with a camera would make, and the truth apart in ``gt/``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yaml
from numpy.typing import NDArray

from pipeline.capture.layout import FOAM, TAG_PLACES, camera_poses
from pipeline.capture.rendering import Lens, Solid, Stage
from pipeline.capture.sensor import jpeg_bytes, photograph
from pipeline.capture.texture import Print, foam_picture
from pipeline.compute.pool import Calls, Work, run_one
from pipeline.records.errors import UserError
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.capture import RenderingParameters
from pipeline.records.poses import pose_matrix
from pipeline.records.writing import json_text, whole_folder
from pipeline.stages.outputs import write_files
from pipeline.stages.seeds import item_generator


@dataclass(frozen=True)
class _Shot:
    """One photo to be taken."""

    solids: tuple[Solid, ...]
    foam: NDArray[np.float32]  # brightness of its top, see foam_picture
    block: Print
    settings: RenderingParameters
    seed: int
    name: str
    view: int
    T_camera_scene: NDArray[np.float64]


def _take(shot: _Shot) -> bytes:
    """Return a photo as JPEG."""
    settings = shot.settings
    stage = Stage(list(shot.solids), shot.foam, shot.block, settings.texture, settings.gloss)
    lens = Lens(settings.width, settings.height, settings.focal * settings.width, settings.distortion)
    light = stage.picture(lens, shot.T_camera_scene)
    pixels = photograph(light, settings, item_generator(shot.seed, "capture", shot.name, shot.view))
    return jpeg_bytes(pixels, settings.jpeg_quality)


def placed_solids(objects: Mapping[str, PreparedObject], settings: RenderingParameters) -> dict[str, Solid]:
    """Return the objects of a rendering, standing on the foam (z = 0).

    Raises:
        UserError: an object stands beside the foam.
    """
    solids = {}
    for name, place in settings.objects.items():
        prepared = objects[name]
        if max(abs(place.position[0]) - FOAM[0] / 2, abs(place.position[1]) - FOAM[1] / 2) > -0.05:
            raise UserError(
                f"params.yaml: renderings: {name} at {list(place.position)} is not on the foam, "
                f"which is {FOAM[0]} x {FOAM[1]} m about the origin; move it 5 cm inside."
            )
        half = np.radians(place.yaw_degrees) / 2
        T = pose_matrix((*place.position, -prepared.bottom), (np.cos(half), 0, 0, np.sin(half)))
        solids[name] = Solid(prepared.vertices, prepared.faces, T)
    return solids


def _scene_text(solids: Mapping[str, Solid], settings: RenderingParameters) -> str:
    """What a person measures with a ruler: to whole millimetres, boxes rounded up."""
    entries = {}
    for name, solid in solids.items():
        low, high = solid.vertices.min(axis=0), solid.vertices.max(axis=0)
        middle = solid.T_scene[:3, :3] @ ((low + high) / 2) + solid.T_scene[:3, 3]
        entries[name] = {
            "position": [round(float(value), 3) for value in middle[:2]],
            "yaw_degrees": float(settings.objects[name].yaw_degrees),
            "box": [float(np.ceil(1000 * extent) / 1000) for extent in high - low],
        }
    return yaml.safe_dump({"support_plane": 0.0, "objects": entries}, sort_keys=False)


def _tags_text(settings: RenderingParameters) -> str:
    tags = {
        number: {"position": [x, y, 0.0], "yaw_degrees": yaw}
        for number, (x, y, yaw) in enumerate(TAG_PLACES[: settings.tags])
    }
    layout = {"family": "tag36h11", "size": settings.tag_size, "convention": "opencv", "tags": tags}
    return yaml.safe_dump(layout, sort_keys=False)


def _surface(solid: Solid) -> bytes:
    """Return the surface of a solid in the scene as PLY."""
    content: Any = trimesh.Trimesh(solid.placed(), solid.faces, process=False).export(file_type="ply")
    return bytes(content)


def photo_name(view: int) -> str:
    """Return the file name of a photo."""
    return f"photo_{view:03d}.jpg"


def rendering(
    name: str, objects: Mapping[str, PreparedObject], settings: RenderingParameters, seed: int
) -> Work[dict[str, bytes]]:
    """Render a capture, photo by photo, and return its files by relative path.

    Raises:
        UserError: see :func:`placed_solids`.
    """
    solids = placed_solids(objects, settings)
    foam = foam_picture(settings.tags, settings.tag_size, item_generator(seed, "capture", "foam", 0))
    block = Print.make(item_generator(seed, "capture", "print", 0))
    scene = tuple(solids.values())
    poses = camera_poses(settings.views, settings.distance, item_generator(seed, "capture", "path", 0))
    shots = [_Shot(scene, foam, block, settings, seed, name, view, pose) for view, pose in enumerate(poses)]
    photos = yield Calls(_take, shots)
    centres = {Path(photo_name(view)).stem: (-T[:3, :3].T @ T[:3, 3]).tolist() for view, T in enumerate(poses)}
    return {
        **{f"images/{photo_name(view)}": photo for view, photo in enumerate(photos)},
        "tags.yaml": _tags_text(settings).encode(),
        "scene.yaml": _scene_text(solids, settings).encode(),
        "gt/cameras.json": json_text({"rendered": True, "centres": centres}).encode(),
        **{f"gt/{object_name}.ply": _surface(solid) for object_name, solid in solids.items()},
    }


def render_capture(
    folder: Path,
    name: str,
    objects: Mapping[str, PreparedObject],
    settings: RenderingParameters,
    seed: int,
    workers: int,
) -> None:
    """Render a capture into ``folder``, as a whole.

    Raises:
        UserError: see :func:`placed_solids`, or the folder cannot be written to.
    """
    files = run_one(rendering(name, objects, settings, seed), workers, f"photos of {name}")
    with whole_folder(folder) as temporary:
        write_files(temporary, files)
