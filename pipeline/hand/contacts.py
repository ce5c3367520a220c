"""Contact candidates of a hand, on the collision shapes of its links, as its description places them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.records.errors import UserError
from pipeline.records.parameters.hand import CapDescription, ContactDescription, GridDescription, HandDescription

ON_SURFACE = 0.0005  # m, how far a contact candidate may be from the link's shapes
SIDES = {sign + axis: s * np.eye(3)[i] for i, axis in enumerate("xyz") for sign, s in (("+", 1.0), ("-", -1.0))}


def contact_candidates(
    description: HandDescription,
    names: Sequence[str],
    boxes: Sequence[tuple[int, NDArray[np.float64], NDArray[np.float64]]],
    spheres: Sequence[tuple[int, NDArray[np.float64], float]],
    file: Path,
) -> tuple[list[int], list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    """Return link, point and normal of every contact candidate, in the order of the description."""
    links: list[int] = []
    points: list[NDArray[np.float64]] = []
    normals: list[NDArray[np.float64]] = []
    for name, entries in description.contacts.items():
        if name not in names:
            raise UserError(f"{file}: contacts names the link {name!r}, which has no shape; describe one under shapes.")
        own_boxes = [(pose, half) for link, pose, half in boxes if names[link] == name]
        own_balls = [(centre, radius) for link, centre, radius in spheres if names[link] == name]
        for number, entry in enumerate(entries):
            where = f"{file}: contacts.{name}.{number}"
            own_points, own_normals = _candidates(entry, own_boxes, own_balls, where)
            beyond = np.abs(distance_to_shapes(np.array(own_points), own_boxes, own_balls))
            if beyond.max() > ON_SURFACE:
                raise UserError(
                    f"{where}: the point {int(beyond.argmax())} is {1000 * beyond.max():.1f} mm off the link's shapes; "
                    "move it onto one."
                )
            links += [names.index(name)] * len(own_points)
            points += own_points
            normals += own_normals
    return links, points, normals


def _candidates(
    entry: ContactDescription,
    boxes: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]],
    balls: Sequence[tuple[NDArray[np.float64], float]],
    where: str,
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    if entry.cap is not None:
        if entry.cap.sphere >= len(balls):
            raise UserError(f"{where}: the link has no ball {entry.cap.sphere}; it has {len(balls)}, counted from 0.")
        centre, radius = balls[entry.cap.sphere]
        cap = cap_points(entry.cap, radius)
        return list(cap + centre), list(cap / radius)
    if entry.grid is not None and entry.normal is not None:
        if not boxes:
            raise UserError(f"{where}: a grid lies on boxes, and the link has none; give it one, or use a cap.")
        points = [_onto_face(point, SIDES[entry.normal], boxes) for point in grid_points(entry.grid)]
        return points, [SIDES[entry.normal]] * len(points)
    given = np.array(entry.normals)
    return list(np.array(entry.points)), list(given / np.linalg.norm(given, axis=1, keepdims=True))


def grid_points(grid: GridDescription) -> NDArray[np.float64]:
    """Return the points (n, 3) of a grid; z changes fastest."""
    return np.array([[x, y, z] for x in grid.x for y in grid.y for z in grid.z])


def cap_points(cap: CapDescription, radius: float) -> NDArray[np.float64]:
    """Return points (n, 3) on a ball about the origin: rings whose heights are spaced evenly."""
    axis, front = SIDES[cap.axis], SIDES[cap.front]
    side = np.cross(axis, front)
    cosines = np.linspace(np.cos(cap.polar[0]), np.cos(cap.polar[1]), len(cap.counts))
    points = []
    for cosine, count in zip(cosines, cap.counts, strict=True):
        sine = np.sqrt(1 - cosine**2)
        for azimuth in np.linspace(-cap.azimuth, cap.azimuth, count):
            points.append(front * (sine * np.cos(azimuth)) + side * (sine * np.sin(azimuth)) + axis * cosine)
    return radius * np.array(points)


def _onto_face(
    point: NDArray[np.float64],
    normal: NDArray[np.float64],
    boxes: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]],
) -> NDArray[np.float64]:
    """Move a point to the nearest one on those faces of boxes that look along ``normal``."""
    along = int(np.abs(normal).argmax())
    best, best_distance = point, np.inf
    for pose, half in boxes:
        centre = pose[:3, 3]
        face = np.clip(point, centre - half, centre + half)
        face[along] = centre[along] + normal[along] * half[along]
        distance = float(np.linalg.norm(face - point))
        if distance < best_distance:
            best, best_distance = face, distance
    return best


def distance_to_shapes(
    points: NDArray[np.float64],
    boxes: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]],
    balls: Sequence[tuple[NDArray[np.float64], float]],
) -> NDArray[np.float64]:
    """Return signed distances (n,), m, of points (n, 3) to the nearest of a link's shapes, link frame."""
    distances = [np.full(len(points), np.inf)]
    for pose, half in boxes:
        beyond = np.abs(points - pose[:3, 3]) - half
        distances.append(np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(1), 0))
    distances += [np.linalg.norm(points - centre, axis=1) - radius for centre, radius in balls]
    return np.min(distances, axis=0)
