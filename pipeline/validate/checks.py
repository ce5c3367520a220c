"""One candidate grasp through physics, check by check.

A new check is a function in :data:`CHECKS`, its reason in ``records.validation_reasons`` and its column in
``records.tables.CHECKED``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.approach import Approach, HandAtObject, choose_approach
from pipeline.hand.model import Hand
from pipeline.hand.moves import squeeze_joints
from pipeline.hand.support import PLANE, Support
from pipeline.physics.holding import HeldGrasp, HeldObject, Holding, hold_in_gravities
from pipeline.physics.settling import settle_grasp
from pipeline.physics.table_pick import TablePick, pick_from_support
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.records.poses import inverse_pose
from pipeline.records.tables import CHECKED, MARGINS, ROBUSTNESS
from pipeline.records.validation_reasons import ValidationReason
from pipeline.robustness.contacts import GraspInHand, Grip
from pipeline.robustness.measures import Measuring, margin_columns, physics_columns


@dataclass(frozen=True)
class Candidate:
    """A synthesized grasp as arrays."""

    style: str
    fingers: tuple[str, ...]
    T_object_hand: NDArray[np.float64]  # (4, 4)
    q: NDArray[np.float64]  # (J,)
    contact_candidates: NDArray[np.int64]  # (n,)
    contact_normals: NDArray[np.float64]  # (n, 3) object frame, outward from the object
    hand: Hand
    support: Support = PLANE  # what the object stands on
    squeeze_q: NDArray[np.float64] | None = None  # (J,) rad, drive targets where the grasp has its own


def assigned_links(hand: Hand, fingers: tuple[str, ...]) -> tuple[str, ...]:
    """Return the links that are meant to hold."""
    return tuple(link for finger in fingers for link in hand.finger_links[finger])


def squeeze_target(candidate: Candidate, advance: float) -> NDArray[np.float64]:
    """Return drive targets (J,), rad, that press the contacts by ``advance`` metres along the inward normals.

    Where the candidate has targets of its own, those.
    """
    if candidate.squeeze_q is not None:
        return candidate.squeeze_q
    T_hand_object = inverse_pose(candidate.T_object_hand)
    inward = -candidate.contact_normals @ T_hand_object[:3, :3].T
    return squeeze_joints(
        candidate.hand, candidate.q, candidate.contact_candidates, inward, advance, list(candidate.fingers)
    )


def held_grasp(prepared: PreparedObject, candidate: Candidate, advance: float) -> HeldGrasp:
    """Return the candidate, squeezed by ``advance`` metres, as the test of holding takes it."""
    held = HeldObject(
        prepared, inverse_pose(candidate.T_object_hand), assigned_links(candidate.hand, candidate.fingers)
    )
    return HeldGrasp((held,), candidate.q, squeeze_target(candidate, advance), candidate.hand)


# Columns that validation adds to a candidate's row.
ADDED = (*CHECKED.names, *MARGINS.names, *ROBUSTNESS.names)
Verdict = tuple[dict[str, Any], str]  # columns, and the reason to reject the candidate: '' if it passed
NOT_MADE: Verdict = ({}, "")  # of a check that is not made for a candidate


@dataclass(frozen=True)
class Inspection:
    """A candidate with what its checks need; what several of them need is computed once."""

    prepared: PreparedObject
    candidate: Candidate
    settings: PhysicsParameters
    limits: ValidateParameters
    holding: Holding | None = None  # outcome of the gravities where they were tested elsewhere

    @cached_property
    def grasp(self) -> HeldGrasp:
        """The candidate and its squeeze."""
        return held_grasp(self.prepared, self.candidate, self.limits.squeeze(self.candidate.style))

    @cached_property
    def approach(self) -> Approach:
        """How the hand comes to the object."""
        candidate, limits = self.candidate, self.limits
        return choose_approach(
            HandAtObject(
                candidate.hand, candidate.style, candidate.T_object_hand, candidate.q, candidate.contact_candidates
            ),
            self.prepared,
            limits.opening(candidate.style),
            lengths=[limits.approach_length],
            support=candidate.support,
        )


def check_candidate(
    prepared: PreparedObject,
    candidate: Candidate,
    settings: PhysicsParameters,
    limits: ValidateParameters,
    holding: Holding | None = None,
    measuring: Measuring | None = None,
) -> dict[str, Any]:
    """Return the columns that physics adds to a candidate's row (:data:`ADDED`), and ``rejected_by``.

    Columns of checks that were not reached are None. ``rejected_by`` is the first failed check, '' if there is none;
    without ``early_rejection`` the others are made all the same.

    Args:
        holding: outcome of the gravities where they were tested elsewhere.
        measuring: what is measured of a candidate that passes; None: nothing.
    """
    inspection = Inspection(prepared, candidate, settings, limits, holding)
    columns = {**dict.fromkeys(ADDED), "squeeze_q": inspection.grasp.squeeze_q}
    rejected_by = ""
    for check in CHECKS:
        if rejected_by and limits.early_rejection:
            break
        found, reason = check(inspection)
        columns |= found
        rejected_by = rejected_by or reason
    if measuring is not None and not rejected_by:
        columns |= measures(inspection, measuring)
    return {**columns, "rejected_by": str(rejected_by)}


def holds_in_gravities(inspection: Inspection) -> Verdict:
    """Hold the object in one gravity direction after the other."""
    limits, grasp = inspection.limits, inspection.grasp
    holding = inspection.holding or hold_in_gravities(
        inspection.settings, limits, grasp.objects, grasp.q, grasp.squeeze_q, grasp.hand
    )
    columns = {
        "gravity_drift": holding.drift[:, 0],
        "gravity_rotation": holding.rotation[:, 0],
        "gravity_in_contact": holding.in_contact[:, 0],
        "contact_only_pass": contact_only(holding, len(limits.gravity_directions)),
    }
    return columns, f"{ValidationReason.GRAVITY}:{holding.failed_direction}" if holding.failed_direction else ""


def is_reached(inspection: Inspection) -> Verdict:
    """Sweep the open hand along its approach."""
    approach = inspection.approach
    columns = {"open_q": approach.open_q, "approach_direction": approach.direction}
    return columns, ValidationReason.APPROACH if approach.penetrations > 0 else ""


def is_picked(inspection: Inspection) -> Verdict:
    """Pick the object off its support, which is then taken away."""
    candidate, limits, approach = inspection.candidate, inspection.limits, inspection.approach
    if not limits.table_test:
        return NOT_MADE
    pick = pick_from_support(
        inspection.settings, limits, inspection.grasp, candidate.T_object_hand, approach, candidate.support
    )
    return {"table_approach_push": pick.push, "table_drift": pick.drift}, table_failure(pick, limits)


def table_failure(pick: TablePick, limits: ValidateParameters) -> str:
    """Return the first check that a pick fails, '' if none; a motion that is not a number fails."""
    if not pick.push <= limits.push_limit:
        return ValidationReason.TABLE_PUSH
    if pick.touched_support:
        return ValidationReason.TABLE_TOUCH
    if not pick.in_contact:
        return ValidationReason.TABLE_DROP
    kept = pick.drift <= limits.drift_limit and pick.rotation <= limits.rotation_limit
    return "" if kept else ValidationReason.TABLE_DRIFT


def settles(inspection: Inspection) -> Verdict:
    """Close the pinching fingers gently, without gravity; part of the tabletop test."""
    candidate, limits, grasp = inspection.candidate, inspection.limits, inspection.grasp
    if candidate.style == "side" or not limits.table_test:
        return NOT_MADE
    T_hand_object = grasp.objects[0].T_hand_object
    _, settled = settle_grasp(
        inspection.prepared,
        T_hand_object,
        candidate.q,
        grasp.squeeze_q,
        limits.for_floating_hand(inspection.settings),
        candidate.hand.style(candidate.style).waiting,
        candidate.hand,
    )
    drift = float(np.linalg.norm((settled - T_hand_object)[:3, 3]))
    # Also when physics lost it and the drift is not a number.
    return {"settling_drift": drift}, "" if drift <= limits.drift_limit else ValidationReason.SETTLING


# In the order in which they are made.
CHECKS: tuple[Callable[[Inspection], Verdict], ...] = (holds_in_gravities, is_reached, is_picked, settles)


def measures(inspection: Inspection, measuring: Measuring) -> dict[str, Any]:
    """Return the measures of a candidate, those in physics where the settings ask for them."""
    candidate, held = inspection.candidate, inspection.grasp
    grip = Grip(held.objects[0], candidate.fingers, candidate.contact_candidates)
    grasp = GraspInHand(candidate.hand, (grip,), held.q, held.squeeze_q)
    (columns,) = margin_columns(grasp, inspection.settings, measuring.settings)
    if not measuring.settings.single_grasps:
        return columns
    return columns | physics_columns(grasp, held, measuring, inspection.settings, inspection.limits)


def contact_only(holding: Holding, directions: int) -> bool | None:
    """Return the paper's verdict: some link presses at the end in all directions; None if it is not known."""
    if not holding.any_contact.all():
        return False
    return True if len(holding.any_contact) == directions else None
