"""One combination of single grasps: every check from cheap to dear, and the row of ``MERGED`` that it becomes.

A check is a function in ``CHECKS``. It returns the columns that it finds out, and the reason for which it rejects the
combination, a member of ``MergeReason``, or None.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.approach import Approach
from pipeline.hand.moves import finger_joints
from pipeline.pairing.approach import later_approach, motion_clearance
from pipeline.pairing.clearance import (
    PosedHand,
    base_clearance,
    hand_clearance,
    held_object_height,
    mount_height,
    object_clearance,
    posed_hand,
    self_clearance,
    support_height,
)
from pipeline.pairing.grasps import JoinedGrasp, fingers_fit, fingers_of, join
from pipeline.pairing.readiness import ReadyFirst, Settled
from pipeline.pairing.task import Task
from pipeline.physics.holding import HeldGrasp, HeldObject, hold_in_gravities
from pipeline.records.merge_reasons import MergeReason
from pipeline.records.ordinals import ORDINALS
from pipeline.records.parameters.hand import PALM
from pipeline.records.poses import position_quaternion
from pipeline.records.tables import MARGINS, MERGED
from pipeline.robustness.contacts import GraspInHand, Grip
from pipeline.robustness.measures import margin_columns, physics_columns

Finding = tuple[dict[str, Any], MergeReason | None]


@dataclass(frozen=True)
class Attempt:
    """One grasp per object, joined into one hand in which all objects but the last are squeezed."""

    task: Task
    ready: tuple[Settled, ...]  # that of the first object as ReadyFirst
    grasp: JoinedGrasp

    @property
    def first(self) -> ReadyFirst:
        """What is known of the grasp of the first object."""
        assert isinstance(self.ready[0], ReadyFirst)
        return self.ready[0]

    @cached_property
    def posed(self) -> PosedHand:
        """The hand around its objects."""
        return posed_hand(self.task.hand, self.grasp.held_q)

    @property
    def later(self) -> range:
        """Numbers of the objects after the first."""
        return range(1, len(self.ready))


def combine(task: Task, ready: Sequence[Settled]) -> Attempt:
    """Join one grasp per object, as :func:`pipeline.pairing.readiness.ready` returns them."""
    grasp = join(task.hand, [one.grasp for one in ready], task.groups)
    held_q = ready[0].held_q.copy()
    for one, group in zip(ready[1:], task.groups[1:], strict=True):
        held_q[finger_joints(group, task.hand)] = one.held_q[finger_joints(group, task.hand)]
    held = replace(grasp, held_q=held_q, T_hand_held=tuple(one.T_hand_held for one in ready))
    return Attempt(task, tuple(ready), held)


def fingers(tried: Attempt) -> Finding:
    """Every grasp uses fingers of its own."""
    fit = fingers_fit(tried.grasp.singles, tried.task.groups)
    return {}, None if fit else MergeReason.FINGERS


def settling(tried: Attempt) -> Finding:
    """No object moves far when the fingers squeeze it."""
    for T_hand_held, T_hand_object in zip(tried.grasp.T_hand_held, tried.grasp.T_hand_object, strict=True):
        moved = np.linalg.norm((T_hand_held - T_hand_object)[:3, 3])
        if not moved <= tried.task.validate.drift_limit:  # also when physics lost it and it is not a number
            return {}, MergeReason.SETTLING
    return {}, None


def objects_apart(tried: Attempt) -> Finding:
    """The objects are apart from each other."""
    clearance = object_clearance(tried.grasp, tried.task.objects)
    reason = MergeReason.OBJECT_CLEARANCE if clearance < tried.task.merge.clearance else None
    return {"object_clearance": clearance}, reason


def hand_apart(tried: Attempt) -> Finding:
    """The objects are apart from what does not hold them; the bases beside the palm may be touched."""
    task, grasp, posed = tried.task, tried.grasp, tried.posed
    clearance = hand_clearance(grasp, posed, task.objects)
    near = (
        clearance < task.merge.clearance
        or base_clearance(grasp, posed, task.objects) < -task.merge.penetration_tolerance
    )
    return {"hand_clearance": clearance}, MergeReason.HAND_CLEARANCE if near else None


def fingers_apart(tried: Attempt) -> Finding:
    """Fingers from different grasps are not in each other."""
    overlap = self_clearance(tried.grasp, tried.posed) < -tried.task.merge.penetration_tolerance
    return {}, MergeReason.SELF_CLEARANCE if overlap else None


def over_supports(tried: Attempt) -> Finding:
    """Mount, hand and what it holds are over what every object after the first stands on."""
    task, grasp = tried.task, tried.grasp
    lowest_mount = np.inf
    for pick in tried.later:
        item, support, T_object_hand = task.objects[pick], task.supports[pick], grasp.singles[pick].T_object_hand
        height = mount_height(grasp.hand, T_object_hand, item, support)
        lowest_mount = min(height, lowest_mount)
        if height < task.merge.mount_clearance:
            return {"mount_clearance": lowest_mount}, MergeReason.MOUNT_CLEARANCE
        lowest = min(
            support_height(posed_hand(task.hand, grasp.posture(pick)), T_object_hand, item.bottom, support=support),
            held_object_height(grasp, pick, task.objects, support),
        )
        if lowest < -task.merge.penetration_tolerance:
            return {"mount_clearance": lowest_mount}, MergeReason.SUPPORT_CLEARANCE
    return {"mount_clearance": lowest_mount}, None


def first_way(tried: Attempt) -> Finding:
    """The hand can come to the first object."""
    blocked = tried.first.opening_clearance < -tried.task.merge.penetration_tolerance
    return _ways(tried, []), MergeReason.FIRST_APPROACH if blocked else None


def later_ways(tried: Attempt) -> Finding:
    """The hand can come to every object after the first, with those before it, and close on it."""
    task, grasp, tolerance = tried.task, tried.grasp, tried.task.merge.penetration_tolerance
    found = []
    for pick in tried.later:
        opening = task.validate.side_opening if PALM in task.groups[pick] else task.validate.pinch_opening
        support, lengths = task.supports[pick], task.merge.approach_lengths
        approach = later_approach(grasp, pick, task.objects, opening, lengths, tolerance, support)
        found.append(approach)
        passes = task.merge.approach_clearance
        if approach.penetrations or (passes is not None and approach.clearance < passes):
            return _ways(tried, found), MergeReason[f"{ORDINALS[pick]}_approach".upper()]
        if motion_clearance(grasp, pick, approach.open_q, task.objects, support) < -tolerance:
            closing = fingers_of([grasp.singles[pick].fingers])[0]
            return _ways(tried, found), MergeReason[f"{closing}_motion".upper()]
    return _ways(tried, found), None


def _ways(tried: Attempt, later: Sequence[Approach]) -> dict[str, Any]:
    return {
        "open_q": [tried.first.open_q, *(way.open_q for way in later)],
        "approach_directions": [tried.first.grasp.approach_direction, *(way.direction for way in later)],
        "approach_lengths": [None, *(way.length for way in later)],
        "sweep_penetrations": [None, *(way.penetrations for way in later)],
    }


def gravity(tried: Attempt) -> Finding:
    """All objects stay in the hand in every gravity direction of ``validate``, directions of the first object's frame.

    The test begins with all objects but the last settled in the squeezing fingers.
    """
    task = tried.task
    if not task.merge.physics_test:
        return {}, None
    held = settled_grasp(tried)
    holding = hold_in_gravities(task.physics, task.validate, held.objects, held.q, held.squeeze_q, held.hand)
    return {"gravity_drift": holding.drift.max(1)}, MergeReason.GRAVITY if holding.failed_direction else None


def held_objects(tried: Attempt, poses: Sequence[NDArray[np.float64]]) -> list[HeldObject]:
    """Return the objects with the links that hold them, at ``T_hand_object`` (4, 4) each."""
    links = tried.task.hand.finger_links
    return [
        HeldObject(item, T_hand_object, tuple(link for finger in single.fingers for link in links[finger]))
        for item, T_hand_object, single in zip(tried.task.objects, poses, tried.grasp.singles, strict=True)
    ]


def planned_grasp(tried: Attempt) -> GraspInHand:
    """Return the grasp as it was planned, before anything has settled: where margins and drawn conditions begin."""
    task, grasp = tried.task, tried.grasp
    grips = tuple(
        Grip(held, single.fingers, single.contact_candidates)
        for held, single in zip(held_objects(tried, grasp.T_hand_object), grasp.singles, strict=True)
    )
    return GraspInHand(task.hand, grips, grasp.q, grasp.squeeze_q)


def settled_grasp(tried: Attempt) -> HeldGrasp:
    """Return the grasp with all objects but the last settled: where the test of holding begins."""
    grasp = tried.grasp
    return HeldGrasp(tuple(held_objects(tried, grasp.T_hand_held)), grasp.held_q, grasp.squeeze_q, tried.task.hand)


def measured(tried: Attempt) -> dict[str, Any]:
    """Return the measures of a grasp that passed all checks, those in physics where it was tested there."""
    task, planned = tried.task, planned_grasp(tried)
    if task.measuring is None:
        return {}
    margins = margin_columns(planned, task.physics, task.measuring.settings)
    columns: dict[str, Any] = {f"{name}s": [own[name] for own in margins] for name in MARGINS.names}
    if not task.merge.physics_test:
        return columns
    return columns | physics_columns(planned, settled_grasp(tried), task.measuring, task.physics, task.validate)


CHECKS: tuple[Callable[[Attempt], Finding], ...] = (
    fingers,
    settling,
    objects_apart,
    hand_apart,
    fingers_apart,
    over_supports,
    first_way,
    later_ways,
    gravity,
)


def check_combination(task: Task, ready: Sequence[Settled]) -> dict[str, Any]:
    """Join grasps, check and measure them, and return the row: all columns of ``MERGED`` but ``merged_id``.

    Args:
        ready: one grasp per object, see :func:`pipeline.pairing.readiness.ready`.
    """
    tried = combine(task, ready)
    row = checked(tried)
    return row if row["rejected_by"] else row | measured(tried)


def checked(tried: Attempt) -> dict[str, Any]:
    """Return the columns of the checks, and what the grasp is, in a row whose other columns are None.

    ``rejected_by`` is the reason of the first check that failed, '' when all passed. Columns of checks that were not
    reached are None or empty lists.
    """
    row = dict.fromkeys(MERGED.names) | _identity(tried) | {"rejected_by": ""}
    for check in CHECKS:
        columns, reason = check(tried)
        row |= columns
        if reason is not None:
            return row | {"rejected_by": reason.value}
    return row


def _identity(tried: Attempt) -> dict[str, Any]:
    grasp = tried.grasp
    poses: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = [position_quaternion(T) for T in grasp.T_hand_object]
    return {
        "objects": [item.name for item in tried.task.objects],
        "grasp_ids": [single.grasp_id for single in grasp.singles],
        "fingers": ["+".join(single.fingers) for single in grasp.singles],
        "q": grasp.q,
        "squeeze_q": grasp.squeeze_q,
        "positions_hand_object": [position for position, _ in poses],
        "quaternions_hand_object": [quaternion for _, quaternion in poses],
        "open_q": [],
        "approach_directions": [grasp.singles[0].approach_direction],
        "approach_lengths": [],
        "sweep_penetrations": [],
    }
