"""Where the ring finger stays while the pinching fingers work, and how the hand comes to the second object.

The straight lines and openings themselves are chosen by ``pipeline.hand.approach``; here the fingers that the other
object occupies are looked after.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.allegro import load_hand
from pipeline.hand.approach import EXTENDED_FINGER, Approach, choose_approach
from pipeline.hand.moves import RING_JOINTS
from pipeline.hand.parts import RING_LINKS
from pipeline.pairing.clearance import hand_object_clearance, links_of, posed_hand, self_clearance, support_height
from pipeline.pairing.grasps import MergedGrasp, SingleGrasp
from pipeline.records.distance import signed_distance
from pipeline.records.objects import PreparedObject
from pipeline.records.poses import inverse_pose, transform_points

EXTENSION_SHARES = (1.0, 0.75, 0.5, 0.25, 0.0)  # of the way from the first grasp's ring finger to the straight one
PATH_SHARES = (0.25, 0.5, 0.75, 1.0)  # where the opening of the ring finger is looked at
FIRST_LINE = np.arange(0.0, 0.0501, 0.005)  # m, stations on the straight way to object 0, from its pre-grasp at 5 cm
ENOUGH = 0.005  # m; a ring finger farther from everything than this is out of the way


def first_opening(first: SingleGrasp, object0: PreparedObject) -> tuple[NDArray[np.float64], float]:
    """Choose the hand's posture for the approach to object 0.

    Pinching fingers as validation opened them; the ring finger straight where object 0 and the support allow it, else
    less so, else as in the validated grasp.

    Returns:
        Joint angles (16,), and the ring finger's smallest signed distance, m, to object 0 (along the way in and after
        closing), to the support plane of object 0 and to the other fingers.
    """
    best: tuple[float, NDArray[np.float64]] | None = None
    for share in EXTENSION_SHARES:
        ring = share * EXTENDED_FINGER + (1 - share) * first.q[RING_JOINTS]
        open_q, closed_q = first.open_q.copy(), first.q.copy()
        open_q[RING_JOINTS] = closed_q[RING_JOINTS] = ring
        clearance = min(_clearance_on_first_way(first, open_q, object0), self_clearance(posed_hand(closed_q)))
        if best is None or clearance > best[0]:
            best = clearance, open_q
        if clearance >= ENOUGH:
            break
    assert best is not None
    return best[1], best[0]


def _clearance_on_first_way(first: SingleGrasp, open_q: NDArray[np.float64], object0: PreparedObject) -> float:
    links = links_of(load_hand(), RING_LINKS)
    posed = posed_hand(open_q)
    points = transform_points(first.T_object_hand, posed.points_on(links))
    swept = points[None] + FIRST_LINE[:, None, None] * first.approach_direction
    return min(
        float(signed_distance(object0, swept).min()),
        float(swept[..., 2].min() - object0.bottom),
        hand_object_clearance(posed, links, object0, inverse_pose(first.T_object_hand)),
        self_clearance(posed),
    )


def second_approach(
    grasp: MergedGrasp,
    object0: PreparedObject,
    object1: PreparedObject,
    opening: float,
    lengths: Sequence[float],
    tolerance: float,
) -> Approach:
    """Choose the opening of the ring finger and the straight line to object 1, with object 0 in the squeezing fingers.

    The ``open_q`` of the result holds targets: pinching fingers squeeze.

    Args:
        opening: first choice of how far the ring's contact points move away, m.
        lengths: m, candidates for the length of the line; the first one that touches nothing is taken.
        tolerance: m, depth below which nothing counts as touching.
    """
    approach = choose_approach(
        load_hand(),
        object1,
        grasp.second.T_object_hand,
        grasp.held_q,
        "side",
        grasp.second.contact_candidates,
        opening,
        lengths,
        carried=[(object0, grasp.T_hand_held0)],
        tolerance=tolerance,
    )
    targets = grasp.squeeze_q.copy()
    targets[RING_JOINTS] = approach.open_q[RING_JOINTS]
    return replace(approach, open_q=targets)


def ring_motion_clearance(
    grasp: MergedGrasp, open_q: NDArray[np.float64], object0: PreparedObject, object1: PreparedObject
) -> float:
    """Return the ring finger's smallest signed distance, m, while it closes from ``open_q`` (16,) to the grasp.

    To object 0, to the support plane of object 1 and to the other fingers; object 1 itself is what it closes on.
    """
    links = links_of(load_hand(), RING_LINKS)
    clearances = []
    for share in PATH_SHARES:
        q = grasp.held_q.copy()
        q[RING_JOINTS] += share * (open_q[RING_JOINTS] - q[RING_JOINTS])
        posed = posed_hand(q)
        clearances += [
            hand_object_clearance(posed, links, object0, grasp.T_hand_held0),
            support_height(posed, grasp.second.T_object_hand, object1.bottom, links),
            self_clearance(posed),
        ]
    return min(clearances)
