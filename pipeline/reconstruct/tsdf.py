"""A truncated signed-distance field that fuses depth pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.reconstruct.rasterise import Target

TRUNCATION = 3.0  # cells


@dataclass
class DistanceField:
    """A grid of distances, positive outside, weighted means over the pictures that saw a cell."""

    origin: NDArray[np.float64]  # (3,), centre of cell [0, 0, 0]
    cell: float  # m
    distance: NDArray[np.float32]  # (nx, ny, nz), in units of the truncation
    weight: NDArray[np.float32]

    @staticmethod
    def empty(low: NDArray[np.float64], high: NDArray[np.float64], cell: float) -> DistanceField:
        """Return a field that covers the box ``low`` .. ``high`` (3,)."""
        shape = tuple(int(n) for n in np.ceil((high - low) / cell) + 1)
        return DistanceField(np.asarray(low), cell, np.zeros(shape, np.float32), np.zeros(shape, np.float32))

    def _centres(self) -> NDArray[np.float64]:
        index = np.stack(np.meshgrid(*(np.arange(n) for n in self.distance.shape), indexing="ij"), axis=-1)
        return self.origin + self.cell * index.reshape(-1, 3)

    def add(self, depth: NDArray[np.float64], target: Target, T_camera_scene: NDArray[np.float64]) -> None:
        """Fuse one depth picture (h, w), m, 0 where unknown."""
        local = self._centres() @ T_camera_scene[:3, :3].T + T_camera_scene[:3, 3]
        column = np.floor(target.focal * local[:, 0] / local[:, 2] + target.centre_x).astype(np.int64)
        row = np.floor(target.focal * local[:, 1] / local[:, 2] + target.centre_y).astype(np.int64)
        inside = (column >= 0) & (column < target.width) & (row >= 0) & (row < target.height)
        seen = np.zeros(len(local))
        seen[inside] = depth[row[inside], column[inside]]
        gap = (seen - local[:, 2]) / (TRUNCATION * self.cell)
        good = (seen > 0) & (gap > -1)
        value = np.minimum(gap, 1).astype(np.float32)
        distance, weight = self.distance.reshape(-1), self.weight.reshape(-1)
        distance[good] = (distance[good] * weight[good] + value[good]) / (weight[good] + 1)
        weight[good] += 1

    def surface(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return points (n, 3) where the distance changes sign along the grid's edges, and outward normals (n, 3)."""
        known = self.weight >= 2
        slope = np.stack([np.gradient(self.distance, axis=axis) for axis in range(3)], axis=-1)
        points, normals = [np.zeros((0, 3))], [np.zeros((0, 3))]
        for axis in range(3):
            first = tuple(slice(0, -1) if k == axis else slice(None) for k in range(3))
            second = tuple(slice(1, None) if k == axis else slice(None) for k in range(3))
            a, b = self.distance[first], self.distance[second]
            cross = known[first] & known[second] & (a * b < 0) & (np.abs(a - b) < 1.5)
            index = np.argwhere(cross).astype(np.float64)
            share = (a / np.where(a == b, 1, a - b))[cross]
            index[:, axis] += share
            points.append(self.origin + self.cell * index)
            normals.append(slope[first][cross] * (1 - share[:, None]) + slope[second][cross] * share[:, None])
        normal = np.concatenate(normals)
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        good = length[:, 0] > 1e-6
        return np.concatenate(points)[good], (normal / np.maximum(length, 1e-9))[good].astype(np.float64)
