"""Finger moves: bring points on links to targets by changing chosen joints only."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.kinematics import link_poses, point_jacobian, points_on_links
from pipeline.hand.model import Hand


def finger_joints(fingers: Sequence[str], hand: Hand) -> NDArray[np.int64]:
    """Return the sorted joint indices of some fingers of a hand; the palm has none."""
    return np.array(sorted(joint for finger in fingers for joint in hand.finger_joints[finger]), dtype=np.int64)


def straight(fingers: Sequence[str], hand: Hand) -> NDArray[np.float64]:
    """Return the angles, rad, of ``finger_joints(fingers, hand)`` of straight fingers that have such a posture."""
    angle: dict[int, float] = {}
    for finger in fingers:
        angle |= dict(zip(hand.finger_joints[finger], hand.straight[finger], strict=True))
    return np.array([angle[joint] for joint in sorted(angle)], dtype=np.float64)


def move_points(
    hand: Hand,
    q: NDArray[np.float64],
    links: Sequence[int],
    points: NDArray[np.float64],
    displacements: NDArray[np.float64],
    joints: NDArray[np.int64],
    iterations: int = 20,
    damping: float = 0.01,
) -> NDArray[np.float64]:
    """Return joint angles (J,) that move points on links by given displacements, as far as the limits allow.

    Damped least squares, repeated; all joints but ``joints`` keep their angle.

    Args:
        q: (J,) start, rad.
        links: link of each point.
        points: (n, 3) in the link frames, m.
        displacements: (n, 3) in the hand frame, m.
        joints: indices of the joints that may move.
        damping: m/rad; larger is slower and steadier near singular postures.
    """
    q = q.copy()
    link_index = np.asarray(links, dtype=np.int64)
    target = points_on_links(link_poses(hand, q[None]), link_index, points)[0] + displacements
    for _ in range(iterations):
        T = link_poses(hand, q[None])
        now = points_on_links(T, link_index, points)[0]
        J = np.concatenate(
            [point_jacobian(hand, T[0], int(link), p)[:, joints] for link, p in zip(link_index, now, strict=True)]
        )
        error = (target - now).ravel()
        step = J.T @ np.linalg.solve(J @ J.T + damping**2 * np.eye(len(error)), error)
        q[joints] = np.clip(q[joints] + step, hand.lower[joints], hand.upper[joints])
    return q


def squeeze_joints(
    hand: Hand,
    q: NDArray[np.float64],
    contact_candidates: NDArray[np.int64],
    inward_normals: NDArray[np.float64],
    advance: float,
    fingers: Sequence[str],
) -> NDArray[np.float64]:
    """Return joint targets (J,) that press the contacts of ``fingers`` by ``advance`` metres into the object.

    Args:
        q: (J,) joint angles of the grasp.
        contact_candidates: (n,) indices into ``hand.contact_points``.
        inward_normals: (n, 3) unit, hand frame, into the object.
    """
    joints = finger_joints(fingers, hand)
    own = np.array([hand.contact_finger[c] in fingers and hand.contact_finger[c] != "palm" for c in contact_candidates])
    chosen = contact_candidates[own]
    return move_points(
        hand, q, list(hand.contact_link[chosen]), hand.contact_points[chosen], advance * inward_normals[own], joints
    )
