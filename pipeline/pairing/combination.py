"""One combination of two single grasps: every check from cheap to dear, and the row that it becomes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.hand.allegro import FINGER_LINKS
from pipeline.hand.moves import RING_JOINTS
from pipeline.pairing.approach import ring_motion_clearance, second_approach
from pipeline.pairing.clearance import (
    base_clearance,
    hand_clearance,
    held_object_height,
    mount_height,
    object_clearance,
    posed_hand,
    self_clearance,
    support_height,
)
from pipeline.pairing.grasps import MergedGrasp, SingleGrasp, fingers_are_disjoint, join
from pipeline.pairing.readiness import ReadyPinch
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.merge import MergeParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.records.poses import position_quaternion
from pipeline.records.tables import MERGED


@dataclass(frozen=True)
class Pair:
    """Two objects and the settings of the checks; the same for all combinations of a pair."""

    object0: PreparedObject
    object1: PreparedObject
    merge: MergeParameters
    physics: PhysicsParameters
    validate: ValidateParameters  # directions, limits and opening of the single grasps' tests


def try_combination(pair: Pair, ready: ReadyPinch, second: SingleGrasp) -> dict[str, Any]:
    """Return the row of one combination, all columns of ``MERGED`` but ``merged_id``.

    ``rejected_by`` is the first failed check, in this order: ``fingers``, ``settling``, ``object_clearance``,
    ``hand_clearance``, ``self_clearance``, ``mount_clearance``, ``support_clearance``, ``first_approach``,
    ``second_approach``, ``ring_motion``, ``gravity``; empty when all passed. Columns of checks that were not reached
    are None.
    """
    grasp = join(ready.grasp, second)
    row: dict[str, Any] = dict.fromkeys(MERGED.names)
    row |= _identity(pair, grasp)
    if not fingers_are_disjoint(ready.grasp, second):
        return row | {"rejected_by": "fingers"}
    moved = np.linalg.norm((ready.T_hand_held0 - grasp.T_hand_object0)[:3, 3])
    if not moved <= pair.validate.drift_limit:  # also when physics lost it and it is not a number
        return row | {"rejected_by": "settling"}
    held_q = ready.held_q.copy()
    held_q[RING_JOINTS] = second.q[RING_JOINTS]
    grasp = replace(grasp, held_q=held_q, T_hand_held0=ready.T_hand_held0)
    row["rejected_by"] = (
        _static_checks(pair, grasp, row)
        or _approach_checks(pair, grasp, ready, row)
        or _gravity_check(pair, grasp, row)
    )
    return row


def _identity(pair: Pair, grasp: MergedGrasp) -> dict[str, Any]:
    position0, quaternion0 = position_quaternion(grasp.T_hand_object0)
    position1, quaternion1 = position_quaternion(grasp.T_hand_object1)
    return {
        "object0": pair.object0.name,
        "object1": pair.object1.name,
        "grasp0_id": grasp.first.grasp_id,
        "grasp1_id": grasp.second.grasp_id,
        "fingers0": "+".join(grasp.first.fingers),
        "fingers1": "+".join(grasp.second.fingers),
        "q": grasp.q,
        "squeeze_q": grasp.squeeze_q,
        "position_hand_object0": position0,
        "quaternion_hand_object0": quaternion0,
        "position_hand_object1": position1,
        "quaternion_hand_object1": quaternion1,
        "approach_direction0": grasp.first.approach_direction,
    }


def _static_checks(pair: Pair, grasp: MergedGrasp, row: dict[str, Any]) -> str:
    tolerance, posed = pair.merge.penetration_tolerance, posed_hand(grasp.held_q)
    row["object_clearance"] = object_clearance(grasp, pair.object0, pair.object1)
    if row["object_clearance"] < pair.merge.clearance:
        return "object_clearance"
    row["hand_clearance"] = hand_clearance(grasp, posed, pair.object0, pair.object1)
    if row["hand_clearance"] < pair.merge.clearance or base_clearance(grasp, posed, pair.object1) < -tolerance:
        return "hand_clearance"
    if self_clearance(posed) < -tolerance:
        return "self_clearance"
    row["mount_clearance"] = mount_height(grasp, pair.object1)
    if row["mount_clearance"] < pair.merge.mount_clearance:
        return "mount_clearance"
    lowest = min(
        support_height(posed, grasp.second.T_object_hand, pair.object1.bottom),
        held_object_height(grasp, pair.object0, pair.object1),
    )
    return "support_clearance" if lowest < -tolerance else ""


def _approach_checks(pair: Pair, grasp: MergedGrasp, ready: ReadyPinch, row: dict[str, Any]) -> str:
    tolerance = pair.merge.penetration_tolerance
    row["open_q0"] = ready.open_q0
    if ready.opening_clearance < -tolerance:
        return "first_approach"
    approach = second_approach(
        grasp, pair.object0, pair.object1, pair.validate.side_opening, pair.merge.approach_lengths, tolerance
    )
    row["open_q1"] = approach.open_q
    row["approach_direction1"] = approach.direction
    row["approach_length1"] = approach.length
    row["sweep_penetrations"] = approach.penetrations
    if approach.penetrations:
        return "second_approach"
    clearance = ring_motion_clearance(grasp, approach.open_q, pair.object0, pair.object1)
    return "ring_motion" if clearance < -tolerance else ""


def _gravity_check(pair: Pair, grasp: MergedGrasp, row: dict[str, Any]) -> str:
    """Hold both objects in every gravity direction of ``validate``, which are directions of object 0's frame.

    The test begins with object 0 settled in the squeezing fingers.
    """
    if not pair.merge.physics_test:
        return ""
    from pipeline.physics.holding import HeldObject, hold_in_gravities

    held = [
        HeldObject(item, T_hand_object, tuple(link for finger in single.fingers for link in FINGER_LINKS[finger]))
        for item, T_hand_object, single in (
            (pair.object0, grasp.T_hand_held0, grasp.first),
            (pair.object1, grasp.T_hand_object1, grasp.second),
        )
    ]
    holding = hold_in_gravities(pair.physics, pair.validate, held, grasp.held_q, grasp.squeeze_q)
    row["gravity_drift"] = holding.drift.max(1)
    return "gravity" if holding.failed_direction else ""
