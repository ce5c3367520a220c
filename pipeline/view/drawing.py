"""What is drawn, as plain arrays in the world frame (m, z up), and where many things stand side by side."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.pictures.camera import framing
from pipeline.records.poses import transform_points

COLUMNS = 8  # of things side by side
PICK_RADIUS = 0.7  # in parts of the spacing: how far from the middle of a thing a click still selects it


@dataclass(frozen=True)
class Solid:
    """One mesh, drawn at one or more places."""

    key: str  # the same key and shape: the browser keeps the mesh that it has
    vertices: NDArray[np.float64]  # (V, 3), own frame
    faces: NDArray[np.int64]  # (F, 3)
    T_world: NDArray[np.float64]  # (n, 4, 4)
    colours: NDArray[np.float64]  # (n, 3), sRGB, 0 to 1
    opacity: float = 1.0

    def corners(self) -> NDArray[np.float64]:
        """Return the corners (8 n, 3) of its boxes in the world."""
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        box = np.stack(np.meshgrid(*np.stack([low, high], axis=1), indexing="ij"), axis=-1).reshape(-1, 3)
        return transform_points(self.T_world, box).reshape(-1, 3)


@dataclass(frozen=True)
class Cloud:
    """Coloured points."""

    key: str
    points: NDArray[np.float64]  # (n, 3)
    colours: NDArray[np.float64]  # (n, 3)
    size: float  # m


@dataclass(frozen=True)
class Lines:
    """Coloured segments."""

    key: str
    ends: NDArray[np.float64]  # (n, 2, 3)
    colours: NDArray[np.float64]  # (n, 3)


@dataclass(frozen=True)
class Drawing:
    """A whole picture."""

    solids: list[Solid] = field(default_factory=list)
    clouds: list[Cloud] = field(default_factory=list)
    lines: list[Lines] = field(default_factory=list)
    labels: list[tuple[str, NDArray[np.float64]]] = field(default_factory=list)  # text and place (3,)
    scenery: list[Solid] = field(default_factory=list)  # what the camera need not show whole
    cells: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))  # middles of what can be clicked
    per_row: int = 1  # cells that belong to one row, which follow each other
    spacing: float = 0.0  # m between neighbouring cells

    def bounds(self) -> NDArray[np.float64]:
        """Return points (n, 3) that enclose it, without the scenery."""
        parts = [solid.corners() for solid in self.solids] + [cloud.points for cloud in self.clouds]
        parts += [line.ends.reshape(-1, 3) for line in self.lines] + [place[None] for _, place in self.labels]
        points = np.concatenate(parts) if parts else np.zeros((0, 3))
        return points if len(points) else np.array([[-0.1, -0.1, 0.0], [0.1, 0.1, 0.2]])


def grid(count: int, spacing: float, columns: int = COLUMNS) -> NDArray[np.float64]:
    """Return places (count, 3) on z = 0 in reading order for who looks along +y: x to the right, rows nearer."""
    order = np.arange(count)
    across = min(columns, max(count, 1))
    return np.stack([(order % across) * spacing, -(order // across) * spacing, np.zeros(count)], axis=1)


def translations(places: ArrayLike) -> NDArray[np.float64]:
    """Return ``T`` (n, 4, 4) that move to ``places`` (n, 3)."""
    places = np.asarray(places, np.float64).reshape(-1, 3)
    T = np.tile(np.eye(4), (len(places), 1, 1))
    T[:, :3, 3] = places
    return T


def picked(drawing: Drawing, origin: ArrayLike, direction: ArrayLike) -> int | None:
    """Return which row a click selects: that of the cell nearest to the ray (both (3,)), None if no cell is near."""
    if not len(drawing.cells):
        return None
    along = np.asarray(direction, np.float64)
    along = along / np.linalg.norm(along)
    offset = drawing.cells - np.asarray(origin, np.float64)
    depth = offset @ along
    beside = np.linalg.norm(offset - depth[:, None] * along, axis=1)
    beside[depth <= 0] = np.inf
    nearest = int(beside.argmin())
    return nearest // drawing.per_row if beside[nearest] <= PICK_RADIUS * drawing.spacing else None


def camera(
    drawing: Drawing, aspect: float, field_of_view: float, from_front: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return position and target (3,) of a camera that sees a drawing.

    Args:
        aspect: width over height of the canvas.
        field_of_view: vertical, rad.
        from_front: from -y, for things side by side; otherwise from the right.
    """
    azimuth, elevation = (-90.0, 50.0) if from_front else (-55.0, 22.0)
    seen = framing(drawing.bounds(), azimuth, elevation, aspect, float(np.degrees(field_of_view)), margin=1.08)
    return seen.position, seen.target
