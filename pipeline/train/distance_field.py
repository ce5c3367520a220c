"""Signed distance and its gradient at many points at once: samples are judged and moved by the hundred."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.records.objects import PreparedObject


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
