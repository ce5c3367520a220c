"""Forward kinematics and point Jacobians of the hand, batched numpy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.allegro import Hand


def _axis_rotation(axis: NDArray[np.float64], angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rodrigues' formula: rotations (B, 3, 3) about one unit ``axis`` (3,) by ``angle`` (B,)."""
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + s * K + (1 - c) * (K @ K)


def link_poses(hand: Hand, q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``T_hand_link`` (B, L, 4, 4) for joint angles ``q`` (B, 16), rad."""
    T = np.zeros((len(q), len(hand.link_names), 4, 4))
    for link, (parent, joint) in enumerate(zip(hand.parent, hand.joint, strict=True)):
        local = np.broadcast_to(hand.origin[link], (len(q), 4, 4))
        if joint >= 0:
            turn = np.zeros((len(q), 4, 4))
            turn[:, :3, :3] = _axis_rotation(hand.axis[link], q[:, joint])
            turn[:, 3, 3] = 1.0
            local = local @ turn
        T[:, link] = local if parent < 0 else T[:, parent] @ local
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
    """Return d(point)/dq (3, 16), m/rad, of one ``point`` (3,) in the hand frame that rides on ``link``.

    Args:
        T_hand_link: (L, 4, 4), one hand.
    """
    J = np.zeros((3, 16))
    while link >= 0:
        joint = hand.joint[link]
        if joint >= 0:
            T = T_hand_link[link]
            J[:, joint] = np.cross(T[:3, :3] @ hand.axis[link], point - T[:3, 3])
        link = int(hand.parent[link])
    return J
