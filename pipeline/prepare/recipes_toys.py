"""Duck, bunny and train, in millimetres, looking along +x.

Duck and bunny are smooth unions of ellipsoids and tapered rods; their fields use only + - * / sqrt min max, which give
the same bits on every machine. (Smooth minimum: the quadratic one of I. Quilez, "Smooth minimum", 2013.)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import manifold3d
import numpy as np
from numpy.typing import NDArray

from pipeline.prepare.level_set import sampling_grid, zero_surface

SPACING = 1.2  # mm of the grid
SIMPLIFICATION = 0.15  # mm; finer leaves edges so short that rounding would close them
SEGMENTS = 48  # of the train's round parts

Field = NDArray[np.float64]
Triple = tuple[float, float, float]


def ellipsoid(points: Field, centre: Triple, radii: Triple) -> Field:
    """Return a field (n,) that is negative inside, about the distance near the surface."""
    scaled = (points - np.array(centre)) / np.array(radii)
    return (np.sqrt((scaled * scaled).sum(axis=1)) - 1) * min(radii)


def rod(points: Field, begin: Triple, end: Triple, radii: tuple[float, float], flat: float = 1.0) -> Field:
    """Return a field (n,) of a tapered round rod, ``flat`` times thinner along y."""
    thin = np.array([1.0, flat, 1.0])
    start, axis = np.array(begin) * thin, (np.array(end) - np.array(begin)) * thin
    relative = points * thin - start
    along = np.minimum(np.maximum((relative * axis).sum(axis=1) / (axis * axis).sum(), 0.0), 1.0)
    across = relative - along[:, None] * axis
    return (np.sqrt((across * across).sum(axis=1)) - (radii[0] + (radii[1] - radii[0]) * along)) / flat


def blended(first: Field, second: Field, width: float) -> Field:
    """Return the smooth union of two fields; the seam is rounded over ``width`` mm."""
    overlap = np.maximum(width - np.abs(first - second), 0.0) / width
    return np.minimum(first, second) - overlap * overlap * width / 4


def _duck_field(points: Field) -> Field:
    field = ellipsoid(points, (-2, 0, 19), (29, 22, 19))
    field = blended(field, rod(points, (-22, 0, 24), (-31, 0, 35), (9, 3)), 8)
    for side in (-1, 1):
        field = blended(field, ellipsoid(points, (-6, 19 * side, 23), (15, 4.5, 9)), 3)
    field = blended(field, ellipsoid(points, (11, 0, 48.5), (17.5, 16.5, 17)), 7)
    field = blended(field, ellipsoid(points, (28, 0, 45), (8, 8.5, 3.2)), 2.5)
    return np.maximum(field, 3.5 - points[:, 2])


def _bunny_field(points: Field) -> Field:
    field = ellipsoid(points, (-6, 0, 19), (23, 18, 18))
    field = blended(field, ellipsoid(points, (9, 0, 17), (14, 14, 17)), 6)
    field = blended(field, ellipsoid(points, (19, 0, 33), (12, 10.5, 11)), 6)
    field = blended(field, ellipsoid(points, (28, 0, 30), (5.5, 6, 5)), 4)
    field = blended(field, ellipsoid(points, (-29, 0, 12), (6, 6, 6)), 3)
    for side in (-1, 1):
        field = blended(field, ellipsoid(points, (-9, 15.5 * side, 12), (14, 8, 12)), 4)
        field = blended(field, ellipsoid(points, (4, 16.5 * side, 4), (11, 6, 5)), 3)
        field = blended(field, ellipsoid(points, (17, 7 * side, 4), (9, 5, 5)), 3)
        field = blended(field, rod(points, (14, 5 * side, 41), (-1, 10 * side, 56), (5.2, 4.2), 1.5), 3)
    return np.maximum(field, 1.0 - points[:, 2])


def _surface(
    field: Callable[[Field], Field], low: Triple, high: Triple
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    corner, opposite = np.array(low, np.float64), np.array(high, np.float64)
    points, origin, shape = sampling_grid(corner, opposite, SPACING)
    vertices, faces = zero_surface(-field(points).reshape(shape), origin, SPACING, corner, opposite)
    return _triangles(manifold3d.Manifold(manifold3d.Mesh64(vertices.copy(), faces.astype(np.uint64))))


def _triangles(solid: Any) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    mesh = solid.simplify(SIMPLIFICATION).to_mesh64()
    return np.asarray(mesh.vert_properties, np.float64)[:, :3], np.asarray(mesh.tri_verts).astype(np.int64)


def duck() -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return a bath duck with tail, wings and a flat beak, sitting on a flat belly."""
    return _surface(_duck_field, (-36, -27, 0), (38, 27, 68))


def bunny() -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return a crouching bunny with haunches, paws, a tail and ears laid back."""
    return _surface(_bunny_field, (-38, -29, 0), (36, 29, 64))


def train() -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return a toy locomotive: chassis, boiler, dome, chimney, cab with roof, six wheels, buffer beam."""

    def box(low: Triple, high: Triple) -> Any:
        return manifold3d.Manifold.cube([b - a for a, b in zip(low, high, strict=True)]).translate(low)

    def upright(x: float, low: float, high: float, bottom: float, top: float) -> Any:
        return manifold3d.Manifold.cylinder(high - low, bottom, top, SEGMENTS).translate((x, 0, low))

    boiler = manifold3d.Manifold.cylinder(48, 13.0, 13.0, SEGMENTS).rotate((0, 90, 0)).translate((-16, 0, 27.5))
    front = manifold3d.Manifold.cylinder(2.4, 11.0, 9.0, SEGMENTS).rotate((0, 90, 0)).translate((31.5, 0, 27.5))
    wheel = manifold3d.Manifold.cylinder(6, 9, 9, SEGMENTS).rotate((90, 0, 0))
    solids = [
        box((-32, -15, 7), (32, 15, 16.5)),  # chassis
        box((31, -14, 8), (33.9, 14, 15)),  # buffer beam
        box((-31, -14, 16), (-11, 14, 50)),  # cab
        box((-33.9, -16, 49), (-8, 16, 53)),  # roof
        boiler,
        front,
        upright(22, 36, 51, 4.6, 5.2),  # chimney
        upright(22, 50.5, 58.9, 5.2, 8.2),
        upright(5, 38, 45.5, 5.5, 4.5),  # dome
    ]
    for x in (-22.0, 0.0, 22.0):
        solids += [wheel.translate((x, -14.9, 9)), wheel.translate((x, 20.9, 9))]
    return _triangles(manifold3d.Manifold.batch_boolean(solids, manifold3d.OpType.Add))
