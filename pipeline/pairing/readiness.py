"""What can be said of a pinch grasp before its partner is known; done once per grasp, as hundreds of pairs use it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.pairing.approach import first_opening
from pipeline.pairing.grasps import SingleGrasp
from pipeline.physics.settling import settle_pinch
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.merge import MergeParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.records.poses import inverse_pose


@dataclass(frozen=True)
class ReadyPinch:
    """A pinch grasp, how its object settles in the squeezing fingers, and the posture in which the hand comes."""

    grasp: SingleGrasp
    held_q: NDArray[np.float64]  # (16,) with the fingers squeezing; the ring's joints mean nothing
    T_hand_held0: NDArray[np.float64]  # (4, 4) of object 0 then
    open_q0: NDArray[np.float64]  # (16,) for the approach to object 0
    opening_clearance: float  # m, smallest distance of the ring finger on that way


def settling_physics(
    merge: MergeParameters, physics: PhysicsParameters, validate: ValidateParameters
) -> PhysicsParameters | None:
    """Return the physics in which an object settles in the floating hand; None when nothing is tested in physics."""
    return validate.for_floating_hand(physics) if merge.physics_test else None


def ready_pinch(object0: PreparedObject, physics: PhysicsParameters | None, grasp: SingleGrasp) -> ReadyPinch:
    """Return what is known of one pinch grasp.

    Args:
        physics: of :func:`settling_physics`. None: nothing settles, object and fingers stay as synthesized.
    """
    held_q, T_hand_held0 = grasp.q, inverse_pose(grasp.T_object_hand)
    if physics is not None:
        held_q, T_hand_held0 = settle_pinch(object0, T_hand_held0, grasp.q, grasp.squeeze_q, physics)
    open_q0, clearance = first_opening(grasp, object0)
    return ReadyPinch(grasp, held_q, T_hand_held0, open_q0, clearance)
