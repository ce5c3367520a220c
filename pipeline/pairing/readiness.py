"""What can be said of a grasp before its partners are known; done once, as hundreds of combinations use it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.support import PLANE, Support
from pipeline.pairing.approach import first_opening
from pipeline.pairing.grasps import PAIR_GROUPS, SingleGrasp, fingers_of
from pipeline.physics.settling import settle_grasp
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.merge import MergeParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.records.poses import inverse_pose


@dataclass(frozen=True)
class Settled:
    """A grasp, and how its object settles in the squeezing fingers."""

    grasp: SingleGrasp
    held_q: NDArray[np.float64]  # (16,) with the fingers squeezing; the joints of other fingers mean nothing
    T_hand_held: NDArray[np.float64]  # (4, 4) of the object then


@dataclass(frozen=True)
class ReadyFirst(Settled):
    """A grasp of the first object, and the posture in which the hand comes."""

    open_q: NDArray[np.float64]  # (16,) for the approach
    opening_clearance: float  # m, smallest distance of the waiting fingers on that way


def settling_physics(
    merge: MergeParameters, physics: PhysicsParameters, validate: ValidateParameters
) -> PhysicsParameters | None:
    """Return the physics in which an object settles in the floating hand; None when nothing is tested in physics."""
    return validate.for_floating_hand(physics) if merge.physics_test else None


def as_synthesized(grasp: SingleGrasp) -> Settled:
    """Return a grasp whose object and fingers stay as they are."""
    return Settled(grasp, grasp.q, inverse_pose(grasp.T_object_hand))


def settled(
    item: PreparedObject, physics: PhysicsParameters | None, waiting: Sequence[str], grasp: SingleGrasp
) -> Settled:
    """Return a grasp with its object settled.

    Args:
        physics: of :func:`settling_physics`. None: nothing settles.
        waiting: fingers that pick other objects later.
    """
    ready = as_synthesized(grasp)
    if physics is None:
        return ready
    return Settled(grasp, *settle_grasp(item, ready.T_hand_held, grasp.q, grasp.squeeze_q, physics, waiting))


def ready_first(
    object0: PreparedObject,
    physics: PhysicsParameters | None,
    grasp: SingleGrasp,
    waiting: Sequence[str] = fingers_of(PAIR_GROUPS[1:]),
    support: Support = PLANE,
) -> ReadyFirst:
    """Return what is known of one grasp of the first object.

    Args:
        physics, waiting: as for :func:`settled`.
        support: what the object stands on.
    """
    ready = settled(object0, physics, waiting, grasp)
    return ReadyFirst(grasp, ready.held_q, ready.T_hand_held, *first_opening(grasp, object0, waiting, support))
