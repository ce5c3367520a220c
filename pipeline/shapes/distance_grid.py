"""Signed distances to a solid, on a grid and at points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.shapes.rays import ray_scene

CHUNK = 1 << 17  # points per query; keeps memory low


@dataclass(frozen=True)
class DistanceGrid:
    """Distances at the cell centres ``origin + spacing * index``."""

    values: NDArray[np.float32]  # (nx, ny, nz), m, positive outside
    origin: NDArray[np.float64]  # (3,) m
    spacing: float  # m


def signed_distances(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], points: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Return exact signed distances (n,) of ``points`` (n, 3) to a closed surface; positive outside.

    The sign is the majority of three parity rays, which is safe because the surface is one repaired solid.
    """
    scene = ray_scene((vertices, faces))
    parts = []
    for begin in range(0, len(points), CHUNK):
        query = points[begin : begin + CHUNK].astype(np.float32)
        parts.append(scene.compute_signed_distance(query, nthreads=1, nsamples=3).numpy())
    return np.concatenate(parts) if parts else np.zeros(0, np.float32)


def distance_grid(vertices: NDArray[np.float64], faces: NDArray[np.int64], cells: int, padding: float) -> DistanceGrid:
    """Return the grid around a solid: ``cells`` on the longest axis, as many as needed on the others.

    Args:
        padding: margin around the object's box, m.
    """
    low, high = vertices.min(axis=0) - padding, vertices.max(axis=0) + padding
    spacing = float((high - low).max() / (cells - 1))
    shape = np.ceil((high - low) / spacing - 1e-9).astype(int) + 1
    origin = (low + high) / 2 - spacing * (shape - 1) / 2
    axes = [origin[axis] + spacing * np.arange(shape[axis]) for axis in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    values = signed_distances(vertices, faces, points).reshape(tuple(shape))
    return DistanceGrid(values, origin, spacing)
