"""Rigid transforms as 4x4 matrices, and their (position, quaternion wxyz) columns in tables."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def pose_matrix(position: ArrayLike, quaternion: ArrayLike) -> NDArray[np.float64]:
    """Return ``T`` (..., 4, 4) from positions (..., 3) and quaternions wxyz (..., 4)."""
    p, quat = np.asarray(position, np.float64), np.asarray(quaternion, np.float64)
    w, x, y, z = np.moveaxis(quat / np.linalg.norm(quat, axis=-1, keepdims=True), -1, 0)
    T = np.zeros((*p.shape[:-1], 4, 4))
    T[..., 0, 0], T[..., 0, 1], T[..., 0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    T[..., 1, 0], T[..., 1, 1], T[..., 1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    T[..., 2, 0], T[..., 2, 1], T[..., 2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    T[..., :3, 3] = p
    T[..., 3, 3] = 1.0
    return T


def position_quaternion(T: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return positions (..., 3) and unit quaternions wxyz (..., 4), w >= 0, of ``T`` (..., 4, 4)."""
    from scipy.spatial.transform import Rotation

    T = np.asarray(T, np.float64)
    flat = Rotation.from_matrix(T[..., :3, :3].reshape(-1, 3, 3)).as_quat(canonical=True, scalar_first=True)
    return T[..., :3, 3].copy(), flat.reshape(*T.shape[:-2], 4)


def inverse_pose(T: ArrayLike) -> NDArray[np.float64]:
    """Return the inverse of rigid transforms (..., 4, 4)."""
    T = np.asarray(T, np.float64)
    R = np.swapaxes(T[..., :3, :3], -1, -2)
    inverse = np.zeros_like(T)
    inverse[..., :3, :3] = R
    inverse[..., :3, 3] = -(R @ T[..., :3, 3:])[..., 0]
    inverse[..., 3, 3] = 1.0
    return inverse


def transform_points(T: ArrayLike, points: ArrayLike) -> NDArray[np.float64]:
    """Apply ``T`` (..., 4, 4) to points (..., n, 3)."""
    T, points = np.asarray(T, np.float64), np.asarray(points, np.float64)
    return points @ np.swapaxes(T[..., :3, :3], -1, -2) + T[..., None, :3, 3]
