"""Convex shapes as balls that cover them, for planners that know nothing else of a robot."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

FINEST, COARSEST = 0.008, 0.04  # m, edge of a cell that one ball covers
BESIDE = 0.25  # of a cell's edge, that its centre may lie outside of the shape
CORNERS = 16  # of the polygons that stand for the ends of a cylinder


def hull_points(shape: Any) -> NDArray[np.float64]:
    """Return points (n, 3), m, whose convex hull is a coal shape; a cylinder's ends become polygons around them."""
    if hasattr(shape, "halfSide"):
        signs = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), -1).reshape(-1, 3)
        return signs * np.asarray(shape.halfSide, np.float64)
    if hasattr(shape, "halfLength"):
        angle = 2 * np.pi * np.arange(CORNERS) / CORNERS
        ring = shape.radius / np.cos(np.pi / CORNERS) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        ends = [np.column_stack([ring, np.full(CORNERS, z)]) for z in (-shape.halfLength, shape.halfLength)]
        return np.concatenate(ends)
    return np.asarray(shape.points(), np.float64)


def covering_balls(shape: Any) -> NDArray[np.float64]:
    """Return balls (n, 4), centre and radius, m, in the frame of a coal shape.

    A ball is itself. Any other shape lies in a box of cells, half as wide as the shape is thin; each cell whose centre
    lies in the shape or close to it is covered by the ball through its corners. A box is covered wholly; of rounder
    shapes, slivers thinner than a quarter of a cell are not.
    """
    if hasattr(shape, "radius") and not hasattr(shape, "halfLength"):
        return np.array([[0.0, 0.0, 0.0, shape.radius]])
    points = hull_points(shape)
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    edge = np.clip(size.min() / 2, FINEST, COARSEST)
    count = np.maximum(np.rint(size / edge), 1).astype(int)
    cell = size / count
    grid = np.stack(np.meshgrid(*(np.arange(number) for number in count), indexing="ij"), -1).reshape(-1, 3)
    centres = low + (grid + 0.5) * cell
    planes = ConvexHull(points).equations
    outside = (centres @ planes[:, :3].T + planes[:, 3]).max(axis=1)
    kept = outside <= BESIDE * cell.min()
    centres = centres[kept] if kept.any() else centres
    return np.column_stack([centres, np.full(len(centres), np.linalg.norm(cell) / 2)])


def placed_balls(balls: NDArray[np.float64], T: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the balls (n, 4) moved by ``T`` (4, 4)."""
    return np.column_stack([balls[:, :3] @ T[:3, :3].T + T[:3, 3], balls[:, 3]])
