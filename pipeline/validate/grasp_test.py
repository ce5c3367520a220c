"""One candidate grasp through physics: six gravities, approach sweep, tabletop test, gentle squeeze of a pinch."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.approach import HandAtObject, choose_approach
from pipeline.hand.model import Hand, load_hand
from pipeline.hand.moves import squeeze_joints
from pipeline.hand.support import PLANE, Support
from pipeline.physics.holding import HeldGrasp, HeldObject, Holding, hold_in_gravities
from pipeline.physics.settling import settle_grasp
from pipeline.physics.table_pick import pick_from_support
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.records.poses import inverse_pose


@dataclass(frozen=True)
class Candidate:
    """A synthesized grasp as arrays."""

    style: str
    fingers: tuple[str, ...]
    T_object_hand: NDArray[np.float64]  # (4, 4)
    q: NDArray[np.float64]  # (J,)
    contact_candidates: NDArray[np.int64]  # (n,)
    contact_normals: NDArray[np.float64]  # (n, 3) object frame, outward from the object
    support: Support = PLANE  # what the object stands on
    hand: Hand = field(default_factory=load_hand)  # the Allegro when left out


def assigned_links(hand: Hand, fingers: tuple[str, ...]) -> tuple[str, ...]:
    """Return the links that are meant to hold."""
    return tuple(link for finger in fingers for link in hand.finger_links[finger])


def squeeze_target(candidate: Candidate, advance: float) -> NDArray[np.float64]:
    """Return drive targets (J,), rad, that press the contacts by ``advance`` metres along the inward normals."""
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


def check_candidate(
    prepared: PreparedObject,
    candidate: Candidate,
    settings: PhysicsParameters,
    limits: ValidateParameters,
    holding: Holding | None = None,
) -> dict[str, Any]:
    """Return the columns that physics adds to a candidate's row; columns of checks not reached are None.

    Args:
        holding: outcome of the gravities where they were tested elsewhere.

    Order: six gravities (``rejected_by`` becomes ``gravity:<direction>``), sweep of the approach (``approach``),
    tabletop test (``table:push``, ``table:touch``, ``table:drop``, ``table:drift``), gentle squeeze of a pinch
    (``settling``). Without ``early_rejection`` every check is made and ``rejected_by`` names the first that failed.
    """
    grasp = held_grasp(prepared, candidate, limits.squeeze_advance)
    squeeze_q = grasp.squeeze_q
    if holding is None:
        holding = hold_in_gravities(settings, limits, grasp.objects, candidate.q, squeeze_q, candidate.hand)
    columns: dict[str, Any] = {
        "squeeze_q": squeeze_q,
        "open_q": None,
        "approach_direction": None,
        "gravity_drift": holding.drift[:, 0],
        "gravity_rotation": holding.rotation[:, 0],
        "gravity_in_contact": holding.in_contact[:, 0],
        "contact_only_pass": contact_only(holding, len(limits.gravity_directions)),
        "table_approach_push": None,
        "table_drift": None,
        "settling_drift": None,
        "rejected_by": f"gravity:{holding.failed_direction}" if holding.failed_direction else "",
    }
    if columns["rejected_by"] and limits.early_rejection:
        return columns
    approach = choose_approach(
        HandAtObject(
            candidate.hand, candidate.style, candidate.T_object_hand, candidate.q, candidate.contact_candidates
        ),
        prepared,
        limits.pinch_opening if candidate.style == "pinch" else limits.side_opening,
        lengths=[limits.approach_length],
        support=candidate.support,
    )
    columns |= {"open_q": approach.open_q, "approach_direction": approach.direction}
    if approach.penetrations > 0:
        columns["rejected_by"] = columns["rejected_by"] or "approach"
    if not limits.table_test or (columns["rejected_by"] and limits.early_rejection):
        return columns
    pick = pick_from_support(settings, limits, grasp, candidate.T_object_hand, approach, candidate.support)
    failure = pick.failure(limits)
    columns |= {"table_approach_push": pick.push, "table_drift": pick.drift}
    columns["rejected_by"] = columns["rejected_by"] or (f"table:{failure}" if failure else "")
    if candidate.style == "side" or (columns["rejected_by"] and limits.early_rejection):
        return columns
    T_hand_object = grasp.objects[0].T_hand_object
    _, settled = settle_grasp(
        prepared,
        T_hand_object,
        candidate.q,
        squeeze_q,
        limits.for_floating_hand(settings),
        candidate.hand.style(candidate.style).waiting,
        candidate.hand,
    )
    columns["settling_drift"] = float(np.linalg.norm((settled - T_hand_object)[:3, 3]))
    if not columns["settling_drift"] <= limits.drift_limit:  # also when physics lost it and it is not a number
        columns["rejected_by"] = columns["rejected_by"] or "settling"
    return columns


def contact_only(holding: Holding, directions: int) -> bool | None:
    """Return the paper's verdict: some link presses at the end in all directions; None if it is not known."""
    if not holding.any_contact.all():
        return False
    return True if len(holding.any_contact) == directions else None
