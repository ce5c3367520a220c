"""The boxes and balls of a hand's links: those of its URDF, those of its description, or fitted ones."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.urdf import Urdf
from pipeline.records.errors import UserError
from pipeline.records.parameters.hand import HandDescription, ShapesDescription

if TYPE_CHECKING:
    from pipeline.hand.fitting import Part, Solid

MOST_SHAPES = 62  # bits of the kernel's mask

Box = tuple[NDArray[np.float64], NDArray[np.float64]]  # pose (4, 4) and half extents (3,), link frame
Ball = tuple[NDArray[np.float64], float]  # centre (3,), link frame, and radius


@dataclass(frozen=True)
class ShapeFit:
    """How well boxes and balls stand for the shapes by which a link collides."""

    shapes: int
    parts: int
    error: float  # m, largest distance between the surfaces, both ways


@dataclass(frozen=True)
class LinkShapes:
    """Shapes of all links, in their order."""

    boxes: list[tuple[int, NDArray[np.float64], NDArray[np.float64]]]  # link, pose, half extents
    spheres: list[tuple[int, NDArray[np.float64], float]]  # link, centre, radius
    fits: Mapping[str, ShapeFit]  # of the links whose shapes were fitted


def link_shapes(names: Sequence[str], description: HandDescription, urdf: Urdf) -> LinkShapes:
    """Return the boxes and balls of all links.

    Raises:
        UserError: there are more than the kernel can take, and describing them by fewer is left to the user.
    """
    own: dict[str, tuple[list[Box], list[Ball]]] = {}
    inexact: list[str] = []
    for name in names:
        if name in description.shapes:
            own[name] = _described(description.shapes[name])
        else:
            boxes, balls, others = urdf.boxes_and_balls(name)
            own[name] = (boxes, balls)
            inexact += [name] if others else []
    total = sum(len(boxes) + len(balls) for boxes, balls in own.values())
    fits: Mapping[str, ShapeFit] = {}
    if inexact or total > MOST_SHAPES:
        candidates = [name for name in names if name not in description.shapes and urdf.has_shape(name)]
        chosen = inexact if total <= MOST_SHAPES - len(inexact) else candidates
        taken = sum(len(boxes) + len(balls) for name, (boxes, balls) in own.items() if name not in chosen)
        if taken + len(chosen) > MOST_SHAPES:
            raise UserError(
                f"{urdf.file}: the hand has {taken} boxes and balls of its description and {len(chosen)} links more, "
                f"{MOST_SHAPES} shapes are possible; describe links by fewer under `shapes`."
            )
        fitted, fits = _fitted(chosen, urdf, MOST_SHAPES - taken, description.shape_error)
        own |= fitted
    placed_boxes = [(index, pose, half) for index, name in enumerate(names) for pose, half in own[name][0]]
    placed_balls = [(index, centre, radius) for index, name in enumerate(names) for centre, radius in own[name][1]]
    return LinkShapes(placed_boxes, placed_balls, fits)


def _described(shapes: ShapesDescription) -> tuple[list[Box], list[Ball]]:
    boxes = [(_placed(np.array(box.centre)), np.array(box.size) / 2) for box in shapes.boxes]
    return boxes, [(np.array(ball.centre), ball.radius) for ball in shapes.spheres]


def _fitted(
    names: Sequence[str], urdf: Urdf, budget: int, tolerance: float
) -> tuple[dict[str, tuple[list[Box], list[Ball]]], Mapping[str, ShapeFit]]:
    """Fit boxes and balls to all shapes of some links, at most ``budget`` of them.

    That takes seconds, so what was found is kept in the user's cache, under a digest of all that it follows from.
    """
    from pipeline.hand.fitting import Region, Solid, exact_error, fit
    from pipeline.hand.meshes import solid

    solids = {name: [Solid(solid(one)) for one in urdf.links[name].iter("collision")] for name in names}
    exact = {name: _known_parts(name, urdf) for name in names}
    kept = _kept_file(solids, exact, budget, tolerance)
    if (rows := _read_kept(kept)) is None:
        links = [
            [Region.whole([own], solids[name], known) for own, known in zip(solids[name], exact[name], strict=True)]
            for name in names
        ]
        fit(links, budget, tolerance)
        rows = []
        for name, regions in zip(names, links, strict=True):
            parts = [region.part for region in regions]
            fitted = any(region.known is None for region in regions)
            error = exact_error(parts, solids[name]) if fitted else None
            rows.append([[[*part.centre.tolist(), *part.half.tolist(), part.radius] for part in parts], error])
        _keep(kept, rows)
    found: dict[str, tuple[list[Box], list[Ball]]] = {}
    fits = {}
    for name, (parts, error) in zip(names, rows, strict=True):
        boxes = [(_placed(np.array(part[:3])), np.array(part[3:6])) for part in parts if part[6] == 0]
        found[name] = boxes, [(np.array(part[:3]), part[6]) for part in parts if part[6] > 0]
        if error is not None:
            fits[name] = ShapeFit(len(solids[name]), len(parts), error)
    return found, fits


def _kept_file(
    solids: Mapping[str, list[Solid]], exact: Mapping[str, list[Part | None]], budget: int, tolerance: float
) -> Path:
    """Return where a fit is kept, whether it is there or not."""
    import pipeline.hand.fitting as fitting

    digest = sha256(Path(fitting.__file__).read_bytes())
    digest.update(repr((budget, tolerance, [[part is None for part in own] for own in exact.values()])).encode())
    for own in solids.values():
        digest.update(repr([one.hull.vertices.tolist() for one in own]).encode())
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return cache / "seqgrasp" / "hand_shapes" / f"{digest.hexdigest()[:32]}.json"


def _read_kept(file: Path) -> list[Any] | None:
    try:
        rows: list[Any] = json.loads(file.read_text())
    except (OSError, ValueError):
        return None
    return rows


def _keep(file: Path, rows: list[Any]) -> None:
    """Write a fit in one go; where that is not possible it is computed again."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", dir=file.parent, delete=False) as stream:
            json.dump(rows, stream)
        os.replace(stream.name, file)
    except OSError:
        return


def _placed(centre: NDArray[np.float64]) -> NDArray[np.float64]:
    pose = np.eye(4)
    pose[:3, 3] = centre
    return pose


def _known_parts(name: str, urdf: Urdf) -> list[Part | None]:
    """Return, per collision shape of a link, the box or ball that it is; None for others."""
    from pipeline.hand.fitting import Part

    boxes, balls, others = urdf.boxes_and_balls(name)
    found: list[Part | None] = []
    for index, collision in enumerate(urdf.links[name].iter("collision")):
        if index in others:
            found.append(None)
        elif collision.find("geometry/box") is not None:
            pose, half = boxes.pop(0)
            found.append(Part(pose[:3, 3], half, 0.0))
        else:
            centre, radius = balls.pop(0)
            found.append(Part(centre, np.zeros(3), radius))
    return found
