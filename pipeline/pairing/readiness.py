"""What can be said of a grasp before its partners are known; done once, as hundreds of combinations use it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.pairing.approach import first_opening
from pipeline.pairing.grasps import SingleGrasp
from pipeline.pairing.task import Task
from pipeline.physics.settling import settle_grasp
from pipeline.records.poses import inverse_pose


@dataclass(frozen=True)
class Settled:
    """A grasp, and how its object settles in the squeezing fingers."""

    grasp: SingleGrasp
    held_q: NDArray[np.float64]  # (J,) with the fingers squeezing; the joints of other fingers mean nothing
    T_hand_held: NDArray[np.float64]  # (4, 4) of the object then


@dataclass(frozen=True)
class ReadyFirst(Settled):
    """A grasp of the first object, and the posture in which the hand comes."""

    open_q: NDArray[np.float64]  # (J,) for the approach
    opening_clearance: float  # m, smallest distance of the waiting fingers on that way


def as_synthesized(grasp: SingleGrasp) -> Settled:
    """Return a grasp whose object and fingers stay as they are."""
    return Settled(grasp, grasp.q, inverse_pose(grasp.T_object_hand))


def ready(task: Task, number: int, grasp: SingleGrasp) -> Settled:
    """Return what is known of one grasp of an object, that of the first one as :class:`ReadyFirst`.

    The last object is not carried to another one, so it is left as synthesized, and so are all where nothing is tested
    in physics.
    """
    found, item = as_synthesized(grasp), task.objects[number]
    physics, waiting = task.settling_physics, task.waiting(number)
    if physics is not None and number < len(task.objects) - 1:
        squeezed = settle_grasp(item, found.T_hand_held, grasp.q, grasp.squeeze_q, physics, waiting, task.hand)
        found = Settled(grasp, *squeezed)
    if number > 0:
        return found
    opening = first_opening(task.hand, grasp, item, waiting, task.supports[0])
    return ReadyFirst(grasp, found.held_q, found.T_hand_held, *opening)
