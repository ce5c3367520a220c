"""Which part of the hand a style of grasp is about: the ring finger and the palm for `side`, the rest for `pinch`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.model import Hand, load_hand
from pipeline.hand.surface import hand_surface
from pipeline.records.parameters.hand import PALM


def part_links(fingers: Sequence[str], hand: Hand | None = None) -> tuple[str, ...]:
    """Return the links of some fingers with the bases that they turn on; the palm does not move and is left out.

    Args:
        hand: the Allegro when left out.
    """
    hand = hand or load_hand()
    chains = [(hand.finger_base[finger], *hand.finger_links[finger]) for finger in fingers if finger != PALM]
    return tuple(link for chain in chains for link in chain if link is not None)


def part_points(style: str, q: NDArray[np.float64], count: int = 300) -> NDArray[np.float64]:
    """Return surface points (n, 3), hand frame, of the part that a merged grasp takes from a grasp of this style.

    The same points of the same links for every ``q`` (16,), so that postures can be compared point by point.

    Args:
        style: ``side``: ring finger and palm; ``pinch``: everything but the ring finger.
        count: points on the whole hand; ``n`` is the share that lies on the part.
    """
    hand = load_hand()
    links, points = hand_surface(count)
    ring = np.isin(links, [hand.link(name) for name in part_links(["ring"], hand)])
    own = ring | (links == hand.link("base_link")) if style == "side" else ~ring
    return points_on_links(link_poses(hand, q[None]), links[own], points[own])[0]
