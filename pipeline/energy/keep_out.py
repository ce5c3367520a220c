"""Where the other object of a pair and the fingers that hold it may be: places to leave free.

A pinch grasp and a side grasp are synthesized apart and joined later into one hand. Each of them leaves free what a
typical grasp of the other style takes: the fingers of that style in a spread of postures in which they hold an object,
and, for side grasps, a ball between the pinching fingertips. All of it is fixed in the hand frame, so that one set of
points serves all grasps. Only what stands out for sure is meant; whether two grasps agree is decided when they merge.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.allegro import FINGER_JOINTS, FINGER_LINKS, load_hand
from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.surface import farthest_points, hand_surface

HAND_POINTS = 2000  # before thinning, about 5 mm apart
EDGE_POINTS = 7  # per edge of a box: objects meet edges first, and points spread over surfaces miss them
# After thinning. The thumb's base stands beside the palm, where every object of a side grasp is.
FINGER_POINTS, THUMB_BASE_POINTS, PINCHED_POINTS = 150, 240, 60

# Angles of a holding finger, rad: the first joint apart, the bending joints together from least to most bent. A tip
# that opposes the thumb at 4 to 7 cm bends so much; the thumb's first joint holds at 1.1 and more, its limit is 1.4.
# Last, a thumb that squeezes: its tip is pressed back to the last joint's limit while the joint before goes on.
HOLDING_ANGLES: dict[str, tuple[tuple[float, ...], NDArray[np.float64]]] = {
    "index": ((-0.2, 0.0, 0.2), np.array([[0.7, 0.2, 0.2], [0.95, 0.45, 0.4], [1.2, 0.7, 0.6]])),
    "middle": ((0.0, 0.25), np.array([[0.7, 0.2, 0.2], [0.95, 0.45, 0.4], [1.2, 0.7, 0.6]])),
    "ring": ((0.0, 0.25), np.array([[0.9, 0.7, 0.7], [1.15, 0.85, 0.9], [1.4, 1.0, 1.1]])),
    "thumb": (
        (1.1, 1.2, 1.3, 1.39),
        np.array([[-0.05, 0.2, 0.2], [0.1, 0.4, 0.4], [0.2, 0.6, 0.5], [0.0, 0.6, -0.1], [0.15, 0.85, -0.1]]),
    ),
}
MIDDLE_BEND = 1  # row of a posture in the middle
THUMB_BASE = "link_12.0"
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


def _link_points(names: Sequence[str]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Links (n,) and points (n, 3) in link frames on surfaces and edges of some links."""
    hand = load_hand()
    chosen = [hand.link(name) for name in names]
    links, points = hand_surface(HAND_POINTS)
    own = np.isin(links, chosen)
    owners, samples = [links[own]], [points[own]]
    for link, pose, half in zip(hand.box_link, hand.box_pose, hand.box_half, strict=True):
        if link in chosen:
            edges = _edges(half) @ pose[:3, :3].T + pose[:3, 3]
            owners.append(np.full(len(edges), link))
            samples.append(edges)
    return np.concatenate(owners), np.concatenate(samples)


def _swept(finger: str, names: Sequence[str], count: int) -> NDArray[np.float64]:
    """Points (count, 3), hand frame, of some links of a finger in all its holding postures."""
    first, bends = HOLDING_ANGLES[finger]
    q = np.zeros((len(first) * len(bends), 16))
    q[:, list(FINGER_JOINTS[finger])] = [(angle, *bend) for angle, bend in product(first, bends)]
    points = points_on_links(link_poses(load_hand(), q), *_link_points(names)).reshape(-1, 3)
    return points[farthest_points(points, count)]


def _pinched() -> NDArray[np.float64]:
    """Points (n, 3), hand frame, on a ball half-way between the tips of the thumb and of index and middle finger."""
    hand = load_hand()
    q = np.zeros((1, 16))
    for finger, (first, bends) in HOLDING_ANGLES.items():
        q[0, list(FINGER_JOINTS[finger])] = (first[len(first) // 2], *bends[MIDDLE_BEND])
    thumb, index, middle = (
        link_poses(hand, q)[0, hand.link(FINGER_LINKS[finger][-1]), :3, 3] for finger in ("thumb", "index", "middle")
    )
    direction = np.random.Generator(np.random.PCG64(0)).normal(size=(PINCHED_POINTS, 3))
    return (thumb + (index + middle) / 2) / 2 + PINCHED_RADIUS * direction / np.linalg.norm(
        direction, axis=1, keepdims=True
    )


@lru_cache(maxsize=4)
def keep_out_points(fingers: tuple[str, ...]) -> NDArray[np.float64]:
    """Return points (n, 3), hand frame, that a grasp with ``fingers`` leaves free."""
    others = [finger for finger in HOLDING_ANGLES if finger not in fingers]
    parts = [_swept(finger, FINGER_LINKS[finger], FINGER_POINTS) for finger in others]
    if "thumb" in others:
        parts += [_swept("thumb", [THUMB_BASE], THUMB_BASE_POINTS), _pinched()]
    return np.concatenate(parts) if parts else np.zeros((0, 3))


def fingers_used(finger_sets: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """Return the fingers of all sets of a style, sorted."""
    return tuple(sorted({finger for fingers in finger_sets for finger in fingers}))
