"""One combination of single grasps: every check from cheap to dear, and the row that a combination of two becomes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.allegro import FINGER_LINKS
from pipeline.hand.moves import finger_joints
from pipeline.hand.support import PLANE, Support
from pipeline.pairing.approach import later_approach, motion_clearance
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
from pipeline.pairing.grasps import PAIR_GROUPS, Groups, JoinedGrasp, SingleGrasp, fingers_fit, fingers_of, join
from pipeline.pairing.readiness import ReadyFirst, Settled, as_synthesized
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.merge import MergeParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.records.poses import position_quaternion
from pipeline.records.tables import MERGED

ORDINALS = ("first", "second", "third", "fourth")  # no hand has room for more


@dataclass(frozen=True)
class Task:
    """Objects in the order of picking and the settings of the checks; the same for all combinations of their grasps."""

    objects: tuple[PreparedObject, ...]
    groups: Groups  # parts of the hand for each
    supports: tuple[Support, ...]  # what each stands on
    merge: MergeParameters
    physics: PhysicsParameters
    validate: ValidateParameters  # directions, limits and opening of the single grasps' tests
    approach_clearance: float = -np.inf  # m, least distance to an object after the first on the way to it


@dataclass
class Verdict:
    """How far a combination got; what was not reached is None or missing at the end of its list."""

    grasp: JoinedGrasp
    rejected_by: str = ""
    object_clearance: float | None = None  # m, likewise the next two; see records.tables.MERGED
    hand_clearance: float | None = None
    mount_clearance: float | None = None
    open_q: list[NDArray[np.float64]] = field(default_factory=list)  # (16,) per object
    approach_direction: list[NDArray[np.float64]] = field(default_factory=list)  # (3,) per object after the first
    approach_length: list[float] = field(default_factory=list)  # m, likewise
    sweep_penetrations: list[int] = field(default_factory=list)  # likewise
    gravity_drift: NDArray[np.float64] | None = None  # (D,) m, of the object that moves most


def check_combination(task: Task, ready: Sequence[Settled]) -> Verdict:
    """Join grasps and check them.

    ``rejected_by`` is the first failed check: ``fingers``, ``settling``, ``object_clearance``, ``hand_clearance``,
    ``self_clearance``; for every object after the first ``mount_clearance``, ``support_clearance``;
    ``first_approach``; for every object after the first ``second_approach`` and so on, and the motion of its finger,
    such as ``ring_motion``; ``gravity``. It is empty when all passed.

    Args:
        ready: one grasp per object, that of the first object as :class:`ReadyFirst`; objects but the last settled.
    """
    singles = [one.grasp for one in ready]
    verdict = Verdict(join(singles, task.groups))
    grasp = verdict.grasp
    if not fingers_fit(singles, task.groups):
        verdict.rejected_by = "fingers"
        return verdict
    for one, T_hand_object in zip(ready, grasp.T_hand_object, strict=True):
        moved = np.linalg.norm((one.T_hand_held - T_hand_object)[:3, 3])
        if not moved <= task.validate.drift_limit:  # also when physics lost it and it is not a number
            verdict.rejected_by = "settling"
            return verdict
    held_q = ready[0].held_q.copy()
    for one, group in zip(ready[1:], task.groups[1:], strict=True):
        held_q[finger_joints(group)] = one.held_q[finger_joints(group)]
    verdict.grasp = replace(grasp, held_q=held_q, T_hand_held=tuple(one.T_hand_held for one in ready))
    first = ready[0]
    assert isinstance(first, ReadyFirst)
    verdict.rejected_by = (
        _static_checks(task, verdict) or _approach_checks(task, verdict, first) or _gravity_check(task, verdict)
    )
    return verdict


def _static_checks(task: Task, verdict: Verdict) -> str:
    grasp, tolerance = verdict.grasp, task.merge.penetration_tolerance
    posed = posed_hand(grasp.held_q)
    verdict.object_clearance = object_clearance(grasp, task.objects)
    if verdict.object_clearance < task.merge.clearance:
        return "object_clearance"
    verdict.hand_clearance = hand_clearance(grasp, posed, task.objects)
    if verdict.hand_clearance < task.merge.clearance or base_clearance(grasp, posed, task.objects) < -tolerance:
        return "hand_clearance"
    if self_clearance(grasp, posed) < -tolerance:
        return "self_clearance"
    for pick in range(1, len(task.objects)):
        item, support, T_object_hand = task.objects[pick], task.supports[pick], grasp.singles[pick].T_object_hand
        height = mount_height(T_object_hand, item, support)
        verdict.mount_clearance = min(height, np.inf if verdict.mount_clearance is None else verdict.mount_clearance)
        if height < task.merge.mount_clearance:
            return "mount_clearance"
        lowest = min(
            support_height(posed_hand(grasp.posture(pick)), T_object_hand, item.bottom, support=support),
            held_object_height(grasp, pick, task.objects, support),
        )
        if lowest < -tolerance:
            return "support_clearance"
    return ""


def _approach_checks(task: Task, verdict: Verdict, first: ReadyFirst) -> str:
    grasp, tolerance = verdict.grasp, task.merge.penetration_tolerance
    verdict.open_q.append(first.open_q)
    if first.opening_clearance < -tolerance:
        return "first_approach"
    for pick in range(1, len(task.objects)):
        fingers = fingers_of([grasp.singles[pick].fingers])
        opening = task.validate.side_opening if "palm" in task.groups[pick] else task.validate.pinch_opening
        support, lengths = task.supports[pick], task.merge.approach_lengths
        approach = later_approach(grasp, pick, task.objects, opening, lengths, tolerance, support)
        verdict.open_q.append(approach.open_q)
        verdict.approach_direction.append(approach.direction)
        verdict.approach_length.append(approach.length)
        verdict.sweep_penetrations.append(approach.penetrations)
        if approach.penetrations or approach.clearance < task.approach_clearance:
            return f"{ORDINALS[pick]}_approach"
        if motion_clearance(grasp, pick, approach.open_q, task.objects, support) < -tolerance:
            return f"{'_'.join(fingers)}_motion"
    return ""


def _gravity_check(task: Task, verdict: Verdict) -> str:
    """Hold all objects in every gravity direction of ``validate``, which are directions of object 0's frame.

    The test begins with all objects but the last settled in the squeezing fingers.
    """
    if not task.merge.physics_test:
        return ""
    from pipeline.physics.holding import HeldObject, hold_in_gravities

    grasp = verdict.grasp
    held = [
        HeldObject(item, T_hand_object, tuple(link for finger in single.fingers for link in FINGER_LINKS[finger]))
        for item, T_hand_object, single in zip(task.objects, grasp.T_hand_held, grasp.singles, strict=True)
    ]
    holding = hold_in_gravities(task.physics, task.validate, held, grasp.held_q, grasp.squeeze_q)
    verdict.gravity_drift = holding.drift.max(1)
    return "gravity" if holding.failed_direction else ""


@dataclass(frozen=True)
class Pair:
    """Two objects and the settings of the checks; the same for all combinations of a pair."""

    object0: PreparedObject
    object1: PreparedObject
    merge: MergeParameters
    physics: PhysicsParameters
    validate: ValidateParameters

    @property
    def task(self) -> Task:
        """Pinch the one, then hold the other with ring finger and palm, both from a plane."""
        objects = (self.object0, self.object1)
        return Task(objects, PAIR_GROUPS, (PLANE, PLANE), self.merge, self.physics, self.validate)


def try_combination(pair: Pair, ready: ReadyFirst, second: SingleGrasp) -> dict[str, Any]:
    """Return the row of one combination of two, all columns of ``MERGED`` but ``merged_id``.

    ``rejected_by`` is the first failed check, in this order: ``fingers``, ``settling``, ``object_clearance``,
    ``hand_clearance``, ``self_clearance``, ``mount_clearance``, ``support_clearance``, ``first_approach``,
    ``second_approach``, ``ring_motion``, ``gravity``; empty when all passed. Columns of checks that were not reached
    are None.
    """
    verdict = check_combination(pair.task, [ready, as_synthesized(second)])
    row: dict[str, Any] = dict.fromkeys(MERGED.names) | _identity(pair, verdict.grasp)
    row |= {
        name: getattr(verdict, name)
        for name in ("object_clearance", "hand_clearance", "mount_clearance", "gravity_drift", "rejected_by")
    }
    row |= {f"open_q{index}": open_q for index, open_q in enumerate(verdict.open_q)}
    for name, values in (
        ("approach_direction1", verdict.approach_direction),
        ("approach_length1", verdict.approach_length),
        ("sweep_penetrations", verdict.sweep_penetrations),
    ):
        row[name] = values[0] if values else None
    return row


def _identity(pair: Pair, grasp: JoinedGrasp) -> dict[str, Any]:
    (first, second), (T_hand_object0, T_hand_object1) = grasp.singles, grasp.T_hand_object
    position0, quaternion0 = position_quaternion(T_hand_object0)
    position1, quaternion1 = position_quaternion(T_hand_object1)
    return {
        "object0": pair.object0.name,
        "object1": pair.object1.name,
        "grasp0_id": first.grasp_id,
        "grasp1_id": second.grasp_id,
        "fingers0": "+".join(first.fingers),
        "fingers1": "+".join(second.fingers),
        "q": grasp.q,
        "squeeze_q": grasp.squeeze_q,
        "position_hand_object0": position0,
        "quaternion_hand_object0": quaternion0,
        "position_hand_object1": position1,
        "quaternion_hand_object1": quaternion1,
        "approach_direction0": first.approach_direction,
    }
