"""Closed surface where sampled values change sign (marching tetrahedra of Manifold)."""

from __future__ import annotations

import manifold3d
import numpy as np
from numpy.typing import NDArray

GRID_OFFSET = 0.371  # cells; keeps grid points off the planes of the shape, where distances are exactly 0


def sampling_grid(
    low: NDArray[np.float64], high: NDArray[np.float64], spacing: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], tuple[int, ...]]:
    """Return points (n, 3) that cover the box ``low``..``high`` with a margin, the first point, and the shape."""
    shape = np.ceil((high - low) / spacing).astype(int) + 6
    origin = low - (3 - GRID_OFFSET) * spacing
    axes = [origin[axis] + spacing * np.arange(shape[axis]) for axis in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3), origin, tuple(int(n) for n in shape)


def zero_surface(
    inside: NDArray[np.float64],
    origin: NDArray[np.float64],
    spacing: float,
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return vertices and outward faces of the surface ``inside`` = 0.

    Args:
        inside: values on the grid of :func:`sampling_grid`, positive inside.
        low, high: (3,) corners of the box that holds the shape.
    """
    shape = inside.shape
    last = [size - 2 for size in shape]
    flat, strides = inside.ravel().tolist(), (int(shape[1] * shape[2]), int(shape[2]))

    def interpolated(x: float, y: float, z: float) -> float:
        fx, fy, fz = (x - origin[0]) / spacing, (y - origin[1]) / spacing, (z - origin[2]) / spacing
        i, j, k = min(max(int(fx), 0), last[0]), min(max(int(fy), 0), last[1]), min(max(int(fz), 0), last[2])
        u, v, w = fx - i, fy - j, fz - k
        at = i * strides[0] + j * strides[1] + k
        rows = []
        for offset in (0, strides[1], strides[0], strides[0] + strides[1]):
            rows.append(flat[at + offset] * (1 - w) + flat[at + offset + 1] * w)
        return (rows[0] * (1 - v) + rows[1] * v) * (1 - u) + (rows[2] * (1 - v) + rows[3] * v) * u

    box = [*(low - 2 * spacing), *(high + 2 * spacing)]
    surface = manifold3d.Manifold.level_set(interpolated, box, spacing, 0.0).to_mesh64()
    return np.asarray(surface.vert_properties, np.float64)[:, :3], np.asarray(surface.tri_verts).astype(np.int64)
