"""Which part of the hand a style of grasp is about: the ring finger and the palm for `side`, the rest for `pinch`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.allegro import FINGER_LINKS, load_hand
from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.surface import hand_surface

FINGER_BASES = {"index": "link_0.0", "middle": "link_4.0", "ring": "link_8.0", "thumb": "link_12.0"}


def part_links(fingers: Sequence[str]) -> tuple[str, ...]:
    """Return the links of some fingers with the bases that they turn on; the palm does not move and is left out."""
    return tuple(
        link for finger in fingers if finger != "palm" for link in (FINGER_BASES[finger], *FINGER_LINKS[finger])
    )


RING_LINKS = part_links(["ring"])


def part_points(style: str, q: NDArray[np.float64], count: int = 300) -> NDArray[np.float64]:
    """Return surface points (n, 3), hand frame, of the part that a merged grasp takes from a grasp of this style.

    The same points of the same links for every ``q`` (16,), so that postures can be compared point by point.

    Args:
        style: ``side``: ring finger and palm; ``pinch``: everything but the ring finger.
        count: points on the whole hand; ``n`` is the share that lies on the part.
    """
    hand = load_hand()
    links, points = hand_surface(count)
    ring = np.isin(links, [hand.link(name) for name in RING_LINKS])
    own = ring | (links == hand.link("base_link")) if style == "side" else ~ring
    return points_on_links(link_poses(hand, q[None]), links[own], points[own])[0]
