"""A closed mesh as an object that the energy, the checks and the physics can use, without the stage ``prepare``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import trimesh
from numpy.typing import NDArray

from pipeline.records.objects import PreparedObject
from pipeline.shapes.rays import ray_scene

if TYPE_CHECKING:
    from pipeline.records.reconstructions import ReconstructedObject

SURFACE_POINTS = 4096
CELLS = 96  # of the distance grid, along its longest axis
PADDING = 0.02  # m of grid around the object
HULL_CORNERS = 240  # physics and planner take no convex shape with more than 255
DENSITY = 500.0  # kg/m3, as in the physics of the pipeline


def object_of_solid(name: str, solid: trimesh.Trimesh) -> PreparedObject:
    """Return a closed mesh whose origin is its centre of mass as an object; its hull is its collision shape."""
    points, owners = trimesh.sample.sample_surface(solid, SURFACE_POINTS, seed=0)
    return _object(name, solid, np.asarray(points, np.float64), np.asarray(solid.face_normals[owners], np.float64))


def object_of_reconstruction(item: ReconstructedObject, grid: bool = True) -> PreparedObject:
    """Return what photos show of an object as an object, in the frame of the reconstruction.

    Args:
        grid: whether with the distance grid, which takes seconds; without, it is empty.
    """
    solid = trimesh.Trimesh(item.vertices, item.faces, process=False)
    return _object(item.name, solid, item.points, item.normals, grid)


def _object(
    name: str, solid: trimesh.Trimesh, points: NDArray[np.float64], normals: NDArray[np.float64], grid: bool = True
) -> PreparedObject:
    distance, low, spacing = _distance_grid(solid) if grid else (np.zeros((0, 0, 0), np.float32), np.zeros(3), 1.0)
    hull = _collision_hull(solid)
    return PreparedObject(
        name=name,
        vertices=np.asarray(solid.vertices, np.float64),
        faces=np.asarray(solid.faces, np.int64),
        parts=((np.asarray(hull.vertices, np.float64), np.asarray(hull.faces, np.int64)),),
        distance=distance,
        distance_origin=low,
        distance_spacing=spacing,
        surface_points=points,
        surface_normals=normals,
        mass=DENSITY * float(solid.volume),
        inertia=DENSITY * np.asarray(solid.moment_inertia, np.float64),
        volume=float(solid.volume),
        extents=np.asarray(solid.extents, np.float64),
        provenance={},
    )


def _distance_grid(solid: trimesh.Trimesh) -> tuple[NDArray[np.float32], NDArray[np.float64], float]:
    """Return signed distances on a grid (nx, ny, nz) around a solid, the grid's first corner (3,) and its spacing."""
    low, high = solid.bounds[0] - PADDING, solid.bounds[1] + PADDING
    spacing = float((high - low).max() / (CELLS - 1))
    axes = [low[k] + spacing * np.arange(int(np.ceil((high - low)[k] / spacing)) + 1) for k in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).astype(np.float32)
    distance = ray_scene((solid.vertices, solid.faces)).compute_signed_distance(grid, nthreads=1).numpy()
    return distance.astype(np.float32), np.asarray(low, np.float64), spacing


def _collision_hull(solid: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return the convex hull, or, if it has too many corners, that of its farthest corners in evenly spread directions.

    The latter lies at most about 1 % of the object's size inside the former (0.6 mm for a ball of 60 mm).
    """
    hull = solid.convex_hull
    if len(hull.vertices) <= HULL_CORNERS:
        return hull
    index = np.arange(HULL_CORNERS) + 0.5  # a spiral of equal areas on the unit sphere
    z, angle = 1 - 2 * index / HULL_CORNERS, np.pi * (1 + np.sqrt(5)) * index
    directions = np.stack([np.sqrt(1 - z**2) * np.cos(angle), np.sqrt(1 - z**2) * np.sin(angle), z], axis=1)
    corners = np.unique((np.asarray(hull.vertices) @ directions.T).argmax(axis=0))
    return trimesh.convex.convex_hull(np.asarray(hull.vertices)[corners])
