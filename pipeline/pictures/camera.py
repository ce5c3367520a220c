"""Pinhole cameras that look at something."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class Camera:
    """A pinhole camera in the world frame; metres and radians."""

    position: NDArray[np.float64]  # (3,)
    target: NDArray[np.float64]  # (3,), seen in the middle of the picture
    field_of_view: float  # vertical, rad

    def axes(self) -> NDArray[np.float64]:
        """Return right, down and forward as rows (3, 3); world z points up in the picture."""
        forward = self.target - self.position
        forward = forward / np.linalg.norm(forward)
        up = np.array([0.0, 0.0, 1.0]) if abs(forward[2]) < 0.999 else np.array([1.0, 0.0, 0.0])
        right = np.cross(forward, up)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(forward, right), forward])

    def pixels(self, points: ArrayLike, width: int, height: int) -> NDArray[np.float64]:
        """Return picture coordinates (n, 2), x right and y down, of world points (n, 3)."""
        local = (np.asarray(points, np.float64) - self.position) @ self.axes().T
        focal = height / 2 / np.tan(self.field_of_view / 2)
        return local[:, :2] / local[:, 2:] * focal + np.array([width, height]) / 2

    def directions(self, width: int, height: int, offset: tuple[float, float]) -> NDArray[np.float32]:
        """Return unit ray directions (height * width, 3) through ``offset`` (0 to 1) within each pixel."""
        focal = height / 2 / np.tan(self.field_of_view / 2)
        x = (np.arange(width) + offset[0] - width / 2) / focal
        y = (np.arange(height) + offset[1] - height / 2) / focal
        right, down, forward = self.axes()
        rays = x[None, :, None] * right + y[:, None, None] * down + forward
        rays /= np.linalg.norm(rays, axis=2, keepdims=True)
        return rays.reshape(-1, 3).astype(np.float32)


def look_at(position: ArrayLike, target: ArrayLike, field_of_view_degrees: float = 35.0) -> Camera:
    """Return a camera at ``position`` that looks at ``target``, both (3,) in the world frame."""
    return Camera(np.asarray(position, np.float64), np.asarray(target, np.float64), np.radians(field_of_view_degrees))


def framing(
    points: ArrayLike,
    azimuth_degrees: float = -55.0,
    elevation_degrees: float = 25.0,
    aspect: float = 4 / 3,
    field_of_view_degrees: float = 30.0,
    margin: float = 1.15,
) -> Camera:
    """Return a camera that sees all ``points`` (n, 3) and not much more.

    Args:
        azimuth_degrees: where the camera stands, counter-clockwise from +x seen from above.
        elevation_degrees: height of the camera over the horizon.
        aspect: width over height of the picture.
        margin: factor on the distance, for air around the points.
    """
    points = np.asarray(points, np.float64)
    azimuth, elevation = np.radians([azimuth_degrees, elevation_degrees])
    away = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    target = (points.min(axis=0) + points.max(axis=0)) / 2
    camera = look_at(target + away, target, field_of_view_degrees)
    half = np.tan(camera.field_of_view / 2)
    across, along, depth = camera.axes() @ (points - target).T
    distance = float((np.maximum(np.abs(across) / aspect, np.abs(along)) / half - depth).max())
    return look_at(target + away * distance * margin, target, field_of_view_degrees)
