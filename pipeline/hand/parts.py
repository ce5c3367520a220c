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

    The fingers that wait in a style are those of the other object; see :func:`joined_points`. The points are the same
    of the same links for every ``q`` (J,), so that postures can be compared point by point.

    Args:
        count: points on the whole hand; ``n`` is the share that lies on the part.
    """
    described = hand.style(style)
    return joined_points(described.fingers, described.waiting, q, hand, count)


def joined_points(
    fingers: Sequence[str], others: Sequence[str], q: NDArray[np.float64], hand: Hand, count: int = 300
) -> NDArray[np.float64]:
    """Return surface points (n, 3), hand frame, of the part that a joined grasp takes from the grasp of one object.

    Where the palm holds the object it is the object's fingers and the palm, else everything but the other fingers.

    Args:
        fingers: those that hold the object, with the palm if it does.
        others: those that hold other objects.
        q: joints (J,) of the grasp, rad.
        count: points on the whole hand; ``n`` is the share that lies on the part, the same points for every ``q``.
    """
    links, points = hand_surface(count, hand)
    if PALM in fingers:
        own = _on(links, (*part_links(fingers, hand), *hand.finger_links[PALM]), hand)
    else:
        own = ~_on(links, part_links(others, hand), hand)
    return points_on_links(link_poses(hand, q[None]), links[own], points[own])[0]


def _on(links: NDArray[np.int64], names: Sequence[str], hand: Hand) -> NDArray[np.bool_]:
    return np.isin(links, [hand.link(name) for name in names])
