"""Forward kinematics and point Jacobians of the hand, batched numpy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.model import Hand


def _axis_rotations(axes: NDArray[np.float64], angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rodrigues' formula: rotations (B, J, 3, 3) about unit ``axes`` (J, 3) by ``angles`` (B, J)."""
    x, y, z = axes.T
    K = np.zeros((len(axes), 3, 3))
    K[:, 0, 1], K[:, 0, 2], K[:, 1, 2] = -z, y, -x
    K[:, 1, 0], K[:, 2, 0], K[:, 2, 1] = z, -y, x
    s, c = np.sin(angles)[..., None, None], np.cos(angles)[..., None, None]
    return np.eye(3) + s * K + (1 - c) * (K @ K)


def link_poses(hand: Hand, q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``T_hand_link`` (B, L, 4, 4) for joint positions ``q`` (B, J), rad, m where they slide."""
    moving = np.nonzero(hand.joint >= 0)[0]
    positions = hand.multiplier[moving] * q[:, hand.joint[moving]] + hand.offset[moving]
    slides = hand.slides[moving]
    moves = np.zeros((len(q), len(moving), 4, 4))
    moves[..., :3, :3] = _axis_rotations(hand.axis[moving], np.where(slides, 0.0, positions))
    moves[..., :3, 3] = hand.axis[moving] * np.where(slides, positions, 0.0)[..., None]
    moves[..., 3, 3] = 1.0
    T = np.empty((len(q), len(hand.link_names), 4, 4))
    T[:] = hand.origin
    T[:, moving] = hand.origin[moving] @ moves  # so far T_parent_link
    for link, parent in enumerate(hand.parent.tolist()):
        if parent >= 0:
            T[:, link] = T[:, parent] @ T[:, link]
    return T


def points_on_links(
    T_hand_link: NDArray[np.float64], link: NDArray[np.int64], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return points (B, n, 3) in the hand frame; ``link`` (n,), ``points`` (n, 3) in their link frames."""
    T = T_hand_link[:, link]
    return np.einsum("bnij,nj->bni", T[..., :3, :3], points) + T[..., :3, 3]


def point_jacobian(
    hand: Hand, T_hand_link: NDArray[np.float64], link: int, point: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return d(point)/dq (3, J), m/rad or 1, of one ``point`` (3,) in the hand frame that rides on ``link``.

    Args:
        T_hand_link: (L, 4, 4), one hand.
    """
    J = np.zeros((3, hand.joint_count))
    while link >= 0:
        joint = hand.joint[link]
        if joint >= 0:
            T = T_hand_link[link]
            axis = T[:3, :3] @ hand.axis[link]
            if hand.slides[link]:
                J[:, joint] += hand.multiplier[link] * axis
            else:
                (ax, ay, az), (rx, ry, rz) = axis, point - T[:3, 3]
                turned = np.array([ay * rz - az * ry, az * rx - ax * rz, ax * ry - ay * rx])
                J[:, joint] += hand.multiplier[link] * turned
        link = int(hand.parent[link])
    return J
