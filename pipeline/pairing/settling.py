"""The pinched object in the squeezing fingers: it settles some millimetres away from the synthesized grasp.

The hand comes to object 1 in this state, so distances and sweeps are taken in it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.approach import EXTENDED_FINGER
from pipeline.pairing.grasps import RING_JOINTS, SingleGrasp
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.poses import inverse_pose

RAMP_SECONDS = 0.5
DWELL_SECONDS = 0.3
RAMP_STEPS = 25


def settle_pinch(
    grasp: SingleGrasp, object0: PreparedObject, settings: PhysicsParameters
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return joint angles (16,) and ``T_hand_object0`` (4, 4) as physics leaves them after the squeeze.

    Without gravity, whose direction changes on the way, and without object 1; the ring finger is straight.
    """
    from pipeline.physics.bodies import add_object
    from pipeline.physics.robots import add_robot
    from pipeline.physics.world import make_world

    start, target = grasp.q.copy(), grasp.squeeze_q.copy()
    start[RING_JOINTS] = target[RING_JOINTS] = EXTENDED_FINGER  # away from object 0
    world = make_world(settings, np.zeros(3))
    robot = add_robot(world, settings, False, np.eye(4), start)
    body = add_object(world, object0, settings, inverse_pose(grasp.T_object_hand))
    for step in range(1, RAMP_STEPS + 1):
        robot.set_targets(start + (target - start) * (step / RAMP_STEPS))
        world.step(world.steps(RAMP_SECONDS / RAMP_STEPS))
    world.step(world.steps(DWELL_SECONDS))
    return robot.q, body.pose
