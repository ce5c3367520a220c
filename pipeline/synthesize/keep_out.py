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
KEEP_OUT_POINTS = 600

# Angles of a holding finger, rad: the first joint apart, the bending joints together from least to most bent. A tip
# that opposes the thumb at 4 to 7 cm bends so much; the thumb's first joint holds at 1.1 and more, its limit is 1.4.
HOLDING_ANGLES: dict[str, tuple[tuple[float, ...], NDArray[np.float64]]] = {
    "index": ((-0.2, 0.0, 0.2), np.array([[0.7, 0.2, 0.2], [0.95, 0.45, 0.4], [1.2, 0.7, 0.6]])),
    "middle": ((-0.2, 0.0, 0.2), np.array([[0.7, 0.2, 0.2], [0.95, 0.45, 0.4], [1.2, 0.7, 0.6]])),
    "ring": ((0.0, 0.15), np.array([[0.9, 0.7, 0.7], [1.2, 0.9, 0.9]])),
    "thumb": ((1.1, 1.2, 1.3, 1.39), np.array([[-0.05, 0.2, 0.2], [0.1, 0.4, 0.4], [0.2, 0.6, 0.5]])),
}
THUMB_BASE = "link_12.0"
PINCHED_RADIUS = 0.025  # m, of a ball that fits into every object of 5 cm and more


def _finger_points(finger: str) -> NDArray[np.float64]:
    """Surface points (n, 3), hand frame, of one finger in all its holding postures."""
    hand = load_hand()
    first, bends = HOLDING_ANGLES[finger]
    q = np.zeros((len(first) * len(bends), 16))
    q[:, list(FINGER_JOINTS[finger])] = [(angle, *bend) for angle, bend in product(first, bends)]
    names = [*FINGER_LINKS[finger], *([THUMB_BASE] if finger == "thumb" else [])]
    links, points = hand_surface(HAND_POINTS)
    own = np.isin(links, [hand.link(name) for name in names])
    return points_on_links(link_poses(hand, q), links[own], points[own]).reshape(-1, 3)


def _pinched_points(count: int = 200) -> NDArray[np.float64]:
    """Points (n, 3), hand frame, on a ball half-way between the tips of thumb and index and middle finger."""
    hand = load_hand()
    q = np.zeros((1, 16))
    for finger, (first, bends) in HOLDING_ANGLES.items():
        q[0, list(FINGER_JOINTS[finger])] = (first[len(first) // 2], *bends[len(bends) // 2])
    tips = {finger: link_poses(hand, q)[0, hand.link(FINGER_LINKS[finger][-1]), :3, 3] for finger in FINGER_JOINTS}
    centre = (tips["thumb"] + (tips["index"] + tips["middle"]) / 2) / 2
    direction = np.random.Generator(np.random.PCG64(0)).normal(size=(count, 3))
    return centre + PINCHED_RADIUS * direction / np.linalg.norm(direction, axis=1, keepdims=True)


@lru_cache(maxsize=4)
def keep_out_points(fingers: tuple[str, ...]) -> NDArray[np.float64]:
    """Return points (n, 3), hand frame, that a grasp with ``fingers`` leaves free, at most ``KEEP_OUT_POINTS``."""
    others = [finger for finger in HOLDING_ANGLES if finger not in fingers]
    parts = [_finger_points(finger) for finger in others]
    if "thumb" in others:
        parts.append(_pinched_points())
    if not parts:
        return np.zeros((0, 3))
    points = np.concatenate(parts)
    return points[farthest_points(points, min(KEEP_OUT_POINTS, len(points)))]


def fingers_used(finger_sets: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """Return the fingers of all sets of a style, sorted."""
    return tuple(sorted({finger for fingers in finger_sets for finger in fingers}))
