"""The first object in the squeezing fingers: it settles some millimetres away from the synthesized grasp.

The hand comes to the second object in this state, so merge takes distances and sweeps in it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.model import Hand
from pipeline.hand.moves import finger_joints, straight
from pipeline.physics.engine import steps_in
from pipeline.physics.world import make_world
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.physics import PhysicsParameters

RAMP_SECONDS = 0.5
DWELL_SECONDS = 0.3
RAMP_STEPS = 25


def settle_grasp(
    prepared: PreparedObject,
    T_hand_object: NDArray[np.float64],
    q: NDArray[np.float64],
    squeeze_q: NDArray[np.float64],
    settings: PhysicsParameters,
    waiting: Sequence[str],
    hand: Hand,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return joint angles (J,) and ``T_hand_object`` (4, 4) as physics leaves them after a gentle squeeze.

    Without gravity, whose direction changes on the way, and without another object; waiting fingers are straight. It
    shows where the object ends and is no test, so of two engines the first is taken.

    Args:
        T_hand_object: (4, 4) in the synthesized grasp.
        q, squeeze_q: (J,) joints of the grasp, and drive targets that press its contacts together, rad.
        waiting: fingers that will pick other objects later.
    """
    start, target = q.copy(), squeeze_q.copy()
    joints = finger_joints(waiting, hand)
    start[joints] = target[joints] = straight(waiting, hand)  # away from the object
    world = make_world(settings.in_engine(settings.engines[0]), np.zeros(3))
    robot = world.add_hand(hand, np.eye(4), start)
    body = world.add_object(prepared, T_hand_object, "object")
    for step in range(1, RAMP_STEPS + 1):
        robot.set_targets(start + (target - start) * (step / RAMP_STEPS))
        world.step(steps_in(RAMP_SECONDS / RAMP_STEPS, world.frequency))
    world.step(steps_in(DWELL_SECONDS, world.frequency))
    return robot.q, body.pose
