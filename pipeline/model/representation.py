"""A grasp of n objects with a hand of J joints as D = 12 n + J numbers, and back.

H = (q, T_hand_object0, T_hand_object1, ...) becomes, object by object,

    position of the object in the hand frame, m (3)
    rotation matrix of T_hand_object, row by row (9)

and then the J joint angles, scaled from their limits to -1..1: 40 numbers for two objects in the Allegro. This is as
published, but for the joints, which the released code leaves in radians. A rotation matrix has no jumps, unlike
angles or quaternions; nine numbers that a network puts out become the nearest rotation by a singular value
decomposition (Levinson et al. 2020, "An Analysis of SVD for Deep Rotation Estimation").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.hand.model import Hand
from pipeline.records.poses import pose_matrix

POSE = 12  # numbers per pose
LEAST_DEVIATION = 1e-3  # a dimension that hardly varies is not blown up


def dimensions(objects: int, hand: Hand) -> int:
    """Return D, how many numbers a grasp of so many objects is."""
    return objects * POSE + hand.joint_count


@dataclass(frozen=True)
class GraspBatch:
    """``B`` grasps of ``n`` objects each; hand frame and joint order as in ``pipeline.records.tables``."""

    T_hand_object: NDArray[np.float64]  # (B, n, 4, 4)
    q: NDArray[np.float64]  # (B, J) rad

    def __len__(self) -> int:
        return len(self.q)

    def __getitem__(self, chosen: NDArray[np.int64] | NDArray[np.bool_]) -> GraspBatch:
        return GraspBatch(self.T_hand_object[chosen], self.q[chosen])


def grasps_of(rows: pd.DataFrame) -> GraspBatch:
    """Return the grasps in rows of a merged table."""
    T = [
        pose_matrix(np.stack(rows[f"position_hand_object{slot}"]), np.stack(rows[f"quaternion_hand_object{slot}"]))
        for slot in (0, 1)
    ]
    return GraspBatch(np.stack(T, axis=1), np.stack(rows["q"]))


@dataclass(frozen=True)
class Normalisation:
    """Mean and standard deviation of every dimension over the training examples."""

    mean: NDArray[np.float64]  # (D,)
    deviation: NDArray[np.float64]  # (D,)

    def apply(self, vectors: NDArray[np.float64]) -> NDArray[np.float64]:
        """Normalise vectors (..., D)."""
        return (vectors - self.mean) / self.deviation

    def undo(self, vectors: NDArray[np.float64]) -> NDArray[np.float64]:
        """Invert :meth:`apply`."""
        return vectors * self.deviation + self.mean


def fit_normalisation(vectors: NDArray[np.float64], normalise: bool) -> Normalisation:
    """Return statistics of vectors (N, D), or those that change nothing."""
    if not normalise:
        return Normalisation(np.zeros(vectors.shape[1]), np.ones(vectors.shape[1]))
    return Normalisation(vectors.mean(0), np.maximum(vectors.std(0), LEAST_DEVIATION))


def to_vectors(hand: Hand, grasps: GraspBatch) -> NDArray[np.float64]:
    """Return grasps as vectors (B, D), not normalised."""
    middle, half = (hand.upper + hand.lower) / 2, (hand.upper - hand.lower) / 2
    parts = []
    for T in np.moveaxis(grasps.T_hand_object, 1, 0):
        parts += [T[:, :3, 3], T[:, :3, :3].reshape(-1, 9)]
    return np.concatenate([*parts, (grasps.q - middle) / half], axis=1)


def from_vectors(hand: Hand, vectors: NDArray[np.float64]) -> GraspBatch:
    """Return the grasps that vectors (B, D) stand for: nearest rotations, joints clamped to their limits."""
    middle, half = (hand.upper + hand.lower) / 2, (hand.upper - hand.lower) / 2
    poses, joints = np.split(vectors, [-hand.joint_count], axis=1)
    T = np.zeros((len(vectors), poses.shape[1] // POSE, 4, 4))
    T[..., 3, 3] = 1.0
    for slot in range(T.shape[1]):
        part = poses[:, slot * POSE : (slot + 1) * POSE]
        T[:, slot, :3, 3] = part[:, :3]
        T[:, slot, :3, :3] = nearest_rotation(part[:, 3:].reshape(-1, 3, 3))
    return GraspBatch(T, middle + half * np.clip(joints, -1.0, 1.0))


def joint_violation(vectors: NDArray[np.float64], hand: Hand) -> NDArray[np.float64]:
    """Return how far joints (B, J) of vectors (B, D) lie beyond their limits, rad, before they are clamped."""
    half = (hand.upper - hand.lower) / 2
    return half * np.maximum(np.abs(vectors[:, -hand.joint_count :]) - 1.0, 0.0)


def nearest_rotation(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotations (..., 3, 3) nearest to any matrices, by Frobenius norm."""
    U, _, V = np.linalg.svd(matrices)
    sign = np.ones(matrices.shape[:-1])
    sign[..., 2] = np.sign(np.linalg.det(U @ V))
    return (U * sign[..., None, :]) @ V


def in_frames(grasps: GraspBatch, T_object_frame: NDArray[np.float64]) -> GraspBatch:
    """Return the same grasps, of objects in other frames, whose poses in the old ones are (B, n, 4, 4)."""
    return GraspBatch(grasps.T_hand_object @ T_object_frame, grasps.q)


def turn_objects(grasps: GraspBatch, angles: NDArray[np.float64]) -> GraspBatch:
    """Return the same grasps of objects whose frames are turned about their z axis by angles (B, n), rad.

    A point p of the old object frame is Rz(angle) p in the new one, so that T_hand_object is multiplied from the
    right by the inverse. (The released code multiplies from the left, which turns the object about the hand.)
    """
    T = grasps.T_hand_object.copy()
    cosine, sine = np.cos(angles), np.sin(angles)
    x, y = T[..., :3, 0].copy(), T[..., :3, 1].copy()
    T[..., :3, 0] = x * cosine[..., None] - y * sine[..., None]
    T[..., :3, 1] = x * sine[..., None] + y * cosine[..., None]
    return GraspBatch(T, grasps.q)
