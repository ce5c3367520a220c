"""Where fingers wait while others work, and how the hand comes to the objects after the first.

The straight lines and openings themselves are chosen by ``pipeline.hand.approach``; here the fingers that other objects
occupy, or will occupy, are looked after.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.approach import Approach, HandAtObject, choose_approach
from pipeline.hand.model import Hand
from pipeline.hand.moves import finger_joints, straight
from pipeline.hand.parts import part_links
from pipeline.hand.support import PLANE, Support
from pipeline.pairing.clearance import (
    PosedHand,
    finger_clearance,
    hand_object_clearance,
    links_of,
    posed_hand,
    support_height,
)
from pipeline.pairing.grasps import JoinedGrasp, SingleGrasp, fingers_of
from pipeline.records.objects import PreparedObject
from pipeline.records.poses import inverse_pose, transform_points
from pipeline.shapes.distance_field import signed_distance

EXTENSION_SHARES = (1.0, 0.75, 0.5, 0.25, 0.0)  # of the way from the first grasp's waiting fingers to straight ones
PATH_SHARES = (0.25, 0.5, 0.75, 1.0)  # where the opening of fingers is looked at
FIRST_LINE = np.arange(0.0, 0.0501, 0.005)  # m, stations on the straight way to object 0, from its pre-grasp at 5 cm
ENOUGH = 0.005  # m; a waiting finger farther from everything than this is out of the way


def first_opening(
    hand: Hand, first: SingleGrasp, object0: PreparedObject, waiting: Sequence[str], support: Support = PLANE
) -> tuple[NDArray[np.float64], float]:
    """Choose the hand's posture for the approach to object 0.

    Its own fingers as validation opened them; waiting fingers straight where object 0 and the support allow it, else
    less so, else as in the validated grasp.

    Returns:
        Joint angles (J,), and the waiting fingers' smallest signed distance, m, to object 0 (along the way in and
        after closing), to the support of object 0 and to the other fingers.
    """
    joints = finger_joints(waiting, hand)
    best: tuple[float, NDArray[np.float64]] | None = None
    for share in EXTENSION_SHARES:
        apart = share * straight(waiting, hand) + (1 - share) * first.q[joints]
        open_q, closed_q = first.open_q.copy(), first.q.copy()
        open_q[joints] = closed_q[joints] = apart
        on_the_way = _clearance_on_first_way(first, posed_hand(hand, open_q), object0, waiting, support)
        clearance = min(on_the_way, finger_clearance(posed_hand(hand, closed_q), waiting))
        if best is None or clearance > best[0]:
            best = clearance, open_q
        if clearance >= ENOUGH:
            break
    assert best is not None
    return best[1], best[0]


def _clearance_on_first_way(
    first: SingleGrasp,
    posed: PosedHand,
    object0: PreparedObject,
    waiting: Sequence[str],
    support: Support,
) -> float:
    links = links_of(posed.hand, part_links(waiting, posed.hand))
    points = transform_points(first.T_object_hand, posed.points_on(links))
    swept = (points[None] + FIRST_LINE[:, None, None] * first.approach_direction).reshape(-1, 3)
    return min(
        float(signed_distance(object0, swept).min()),
        float((swept[:, 2] - support.level(object0.bottom, swept)).min()),
        hand_object_clearance(posed, links, object0, inverse_pose(first.T_object_hand)),
        finger_clearance(posed, waiting),
    )


def later_approach(
    grasp: JoinedGrasp,
    pick: int,
    objects: Sequence[PreparedObject],
    opening: float,
    lengths: Sequence[float],
    tolerance: float,
    support: Support = PLANE,
) -> Approach:
    """Choose the opening of the fingers and the straight line to an object after the first, with the others in hand.

    The ``open_q`` of the result holds targets: fingers that hold squeeze; fingers that wait are straight.

    Args:
        pick: number of the object.
        opening: first choice of how far the contact points of its fingers move away, m.
        lengths: m, candidates for the length of the line; the first one that touches nothing is taken.
        tolerance: m, depth below which nothing counts as touching.
        support: what the object stands on.
    """
    single = grasp.singles[pick]
    style = "side" if "palm" in single.fingers else "pinch"
    approach = choose_approach(
        HandAtObject(grasp.hand, style, single.T_object_hand, grasp.posture(pick), single.contact_candidates),
        objects[pick],
        opening,
        lengths,
        carried=list(zip(objects[:pick], grasp.T_hand_held[:pick], strict=True)),
        tolerance=tolerance,
        support=support,
    )
    targets = grasp.squeeze_q.copy()
    free = finger_joints(fingers_of(grasp.groups[pick:]), grasp.hand)
    targets[free] = approach.open_q[free]
    return replace(approach, open_q=targets)


def motion_clearance(
    grasp: JoinedGrasp,
    pick: int,
    open_q: NDArray[np.float64],
    objects: Sequence[PreparedObject],
    support: Support = PLANE,
) -> float:
    """Return the smallest signed distance, m, of the fingers of an object after the first, while they close on it.

    They move from ``open_q`` (J,) to the grasp; to the objects held already, to what their own stands on and to the
    other fingers; their own object is what they close on. Waiting fingers count with them.
    """
    hand, moving = grasp.hand, fingers_of(grasp.groups[pick:])
    links, own = links_of(hand, part_links(moving, hand)), finger_joints(moving, hand)
    T_object_hand = grasp.singles[pick].T_object_hand
    clearances = []
    for share in PATH_SHARES:
        q = grasp.posture(pick)
        q[own] += share * (open_q[own] - q[own])
        posed = posed_hand(hand, q)
        clearances += [
            hand_object_clearance(posed, links, held, T_hand_held)
            for held, T_hand_held in zip(objects[:pick], grasp.T_hand_held[:pick], strict=True)
        ]
        clearances += [
            support_height(posed, T_object_hand, objects[pick].bottom, links, support),
            finger_clearance(posed, moving),
        ]
    return min(clearances)
