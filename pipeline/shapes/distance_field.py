"""Look-ups in the signed-distance grid of a prepared object: the distance alone, or with its gradient."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from pipeline.records.objects import PreparedObject


def signed_distance(prepared: PreparedObject, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return signed distances (...) of ``points`` (..., 3), object frame, m; positive outside, trilinear.

    Outside the grid the distance to the grid's box is added to the value at its border: an upper bound on the true
    distance that is exact enough for clearance tests, which only care about what is near.
    """
    flat = points.reshape(-1, 3)
    coordinates = (flat - prepared.distance_origin) / prepared.distance_spacing
    inside = np.clip(coordinates, 0, np.array(prepared.distance.shape) - 1)
    value = map_coordinates(prepared.distance, inside.T, order=1, output=np.float64)
    beyond = np.linalg.norm(coordinates - inside, axis=1) * prepared.distance_spacing
    return (value + beyond).reshape(points.shape[:-1])


class DistanceField:
    """Trilinear look-ups in the distance grid of a prepared object; beyond it, the distance to the grid is added."""

    def __init__(self, prepared: PreparedObject) -> None:
        self.grid = np.ascontiguousarray(prepared.distance)
        self.origin, self.spacing = prepared.distance_origin, prepared.distance_spacing

    def look_up(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return signed distances (...), m, positive outside, and gradients (..., 3) at points (..., 3)."""
        flat = (points.reshape(-1, 3) - self.origin) / self.spacing
        inside = np.clip(flat, 0, np.array(self.grid.shape) - 1.0)
        low = np.minimum(inside.astype(np.int64), np.array(self.grid.shape) - 2)
        share = inside - low
        _, ny, nz = self.grid.shape
        first = (low[:, 0] * ny + low[:, 1]) * nz + low[:, 2]
        values = self.grid.reshape(-1)
        corner = np.stack([values[first + (a * ny + b) * nz + c] for a in (0, 1) for b in (0, 1) for c in (0, 1)], 1)
        cube = corner.reshape(-1, 2, 2, 2).astype(np.float64)
        x, y, z = share.T
        face = cube[:, 0] + x[:, None, None] * (cube[:, 1] - cube[:, 0])
        edge = face[:, 0] + y[:, None] * (face[:, 1] - face[:, 0])
        value = edge[:, 0] + z * (edge[:, 1] - edge[:, 0])
        slope_x = cube[:, 1] - cube[:, 0]
        slope_x = slope_x[:, 0] + y[:, None] * (slope_x[:, 1] - slope_x[:, 0])
        slope_y = face[:, 1] - face[:, 0]
        gradient = np.stack(
            [
                slope_x[:, 0] + z * (slope_x[:, 1] - slope_x[:, 0]),
                slope_y[:, 0] + z * (slope_y[:, 1] - slope_y[:, 0]),
                edge[:, 1] - edge[:, 0],
            ],
            axis=1,
        )
        gradient /= self.spacing
        outside = flat - inside
        beyond = np.linalg.norm(outside, axis=1)
        value = value + beyond * self.spacing
        gradient = np.where(outside != 0, 0.0, gradient) + outside / np.maximum(beyond, 1e-9)[:, None]
        return value.reshape(points.shape[:-1]), gradient.reshape(points.shape)
