"""Where another object in the hand and the fingers that hold it may be: places to leave free.

Grasps of different styles are synthesized apart and joined later into one hand. Each of them leaves free what a typical
grasp with the other fingers takes: those fingers in a spread of postures in which they hold an object (``holding`` of
the hand's description), and, for grasps without the opposing fingers, a ball between the pinching fingertips. All of it
is fixed in the hand frame, so that one set of points serves all grasps. Only what stands out for sure is meant; whether
two grasps agree is decided when they merge.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.model import Hand
from pipeline.hand.surface import farthest_points, hand_surface

HAND_POINTS = 2000  # before thinning, about 5 mm apart
EDGE_POINTS = 7  # per edge of a box: objects meet edges first, and points spread over surfaces miss them
# After thinning. The base of an opposing finger (a thumb) stands beside the palm, where the objects of side grasps are.
FINGER_POINTS, BASE_POINTS, PINCHED_POINTS = 150, 240, 60
TYPICAL = 1  # row of ``holding.bent``
PINCHED_RADIUS = 0.025  # m, of a ball that fits into every object of 5 cm and more


def _edges(half: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (n, 3) along the twelve edges of a box about the origin, corners included."""
    along = np.linspace(-1.0, 1.0, EDGE_POINTS)
    points = [
        np.roll([share, one, other], axis)
        for axis in range(3)
        for one in (-1, 1)
        for other in (-1, 1)
        for share in along
    ]
    return np.array(points) * half


def _link_points(names: Sequence[str], hand: Hand) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Links (n,) and points (n, 3) in link frames on surfaces and edges of some links."""
    chosen = [hand.link(name) for name in names]
    links, points = hand_surface(HAND_POINTS, hand)
    own = np.isin(links, chosen)
    owners, samples = [links[own]], [points[own]]
    for link, pose, half in zip(hand.box_link, hand.box_pose, hand.box_half, strict=True):
        if link in chosen:
            edges = _edges(half) @ pose[:3, :3].T + pose[:3, 3]
            owners.append(np.full(len(edges), link))
            samples.append(edges)
    return np.concatenate(owners), np.concatenate(samples)


def _swept(finger: str, names: Sequence[str], count: int, hand: Hand) -> NDArray[np.float64]:
    """Points (count, 3), hand frame, of some links of a finger in all its holding postures."""
    first, bent = hand.holding[finger].first, hand.holding[finger].bent
    q = np.zeros((len(first) * len(bent), hand.joint_count))
    q[:, list(hand.finger_joints[finger])] = [(angle, *row) for angle, row in product(first, bent)]
    points = points_on_links(link_poses(hand, q), *_link_points(names, hand)).reshape(-1, 3)
    return points[farthest_points(points, count)]


def _pinched(hand: Hand) -> NDArray[np.float64]:
    """Points (n, 3), hand frame, on a ball half-way between the tips of the opposing and of the other fingers."""
    q = np.zeros((1, hand.joint_count))
    for finger, holding in hand.holding.items():
        q[0, list(hand.finger_joints[finger])] = (holding.first[len(holding.first) // 2], *holding.bent[TYPICAL])
    T_hand_link = link_poses(hand, q)[0]
    pinching = [finger for finger in hand.style("pinch").fingers if finger in hand.holding]
    sides = [
        np.mean([T_hand_link[hand.link(hand.finger_links[finger][-1]), :3, 3] for finger in side], axis=0)
        for side in (
            [finger for finger in pinching if finger in hand.opposing],
            [finger for finger in pinching if finger not in hand.opposing],
        )
    ]
    direction = np.random.Generator(np.random.PCG64(0)).normal(size=(PINCHED_POINTS, 3))
    return (sides[0] + sides[1]) / 2 + PINCHED_RADIUS * direction / np.linalg.norm(direction, axis=1, keepdims=True)


@lru_cache(maxsize=4)
def keep_out_points(fingers: tuple[str, ...], hand: Hand) -> NDArray[np.float64]:
    """Return points (n, 3), hand frame, that a grasp with ``fingers`` leaves free."""
    others = [finger for finger in hand.holding if finger not in fingers]
    parts = [_swept(finger, hand.finger_links[finger], FINGER_POINTS, hand) for finger in others]
    opposing = [finger for finger in others if finger in hand.opposing]
    for finger in opposing:
        base = hand.finger_base[finger]
        parts += [_swept(finger, [base], BASE_POINTS, hand)] if base is not None else []
    if opposing:
        parts.append(_pinched(hand))
    return np.concatenate(parts) if parts else np.zeros((0, 3))


def fingers_used(finger_sets: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """Return the fingers of all sets of a style, sorted."""
    return tuple(sorted({finger for fingers in finger_sets for finger in fingers}))
