"""Which part of the hand counts in a grasp of a style, where several objects share the hand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.model import Hand
from pipeline.hand.surface import hand_surface
from pipeline.records.parameters.hand import PALM


def part_links(fingers: Sequence[str], hand: Hand) -> tuple[str, ...]:
    """Return the links of some fingers with the bases that they turn on; the palm does not move and is left out."""
    chains = [(hand.finger_base[finger], *hand.finger_links[finger]) for finger in fingers if finger != PALM]
    return tuple(link for chain in chains for link in chain if link is not None)


def part_points(style: str, q: NDArray[np.float64], hand: Hand, count: int = 300) -> NDArray[np.float64]:
    """Return surface points (n, 3), hand frame, of the part that a merged grasp takes from a grasp of this style.

    That is the style's fingers and the palm if it is one of them. A style that makes fingers wait is that of the first
    object, from whose grasp the whole hand but for those fingers is taken. The same points of the same links for every
    ``q`` (J,), so that postures can be compared point by point.

    Args:
        count: points on the whole hand; ``n`` is the share that lies on the part.
    """
    described = hand.style(style)
    links, points = hand_surface(count, hand)
    own = _on(links, part_links(described.fingers, hand), hand)
    if described.waiting:
        own = ~_on(links, part_links(described.waiting, hand), hand)
    elif PALM in described.fingers:
        own |= _on(links, hand.finger_links[PALM], hand)
    return points_on_links(link_poses(hand, q[None]), links[own], points[own])[0]


def _on(links: NDArray[np.int64], names: Sequence[str], hand: Hand) -> NDArray[np.bool_]:
    return np.isin(links, [hand.link(name) for name in names])
