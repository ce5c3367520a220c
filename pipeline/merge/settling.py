"""The pinched object in the squeezing fingers: it settles some millimetres away from the synthesized grasp.

The hand comes to object 1 in this state, so distances and sweeps are taken in it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.hand.approach import EXTENDED_FINGER
from pipeline.merge.grasps import RING_JOINTS, MergedGrasp
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.physics import PhysicsParameters

RAMP_SECONDS = 0.5
DWELL_SECONDS = 0.3
RAMP_STEPS = 25


def settle_pinch(grasp: MergedGrasp, object0: PreparedObject, settings: PhysicsParameters) -> MergedGrasp:
    """Return the grasp with ``held_q`` and ``T_hand_held0`` as physics leaves them after the squeeze.

    Without gravity, whose direction changes on the way, and without object 1; the ring is kept at its grasp in the
    result and straight in the simulation.
    """
    from pipeline.physics.bodies import add_object
    from pipeline.physics.robots import add_robot
    from pipeline.physics.world import make_world

    start, target = grasp.q.copy(), grasp.squeeze_q.copy()
    start[RING_JOINTS] = target[RING_JOINTS] = EXTENDED_FINGER  # away from object 0
    world = make_world(settings, np.zeros(3))
    robot = add_robot(world, settings, False, np.eye(4), start)
    body = add_object(world, object0, settings, grasp.T_hand_object0)
    for step in range(1, RAMP_STEPS + 1):
        robot.set_targets(start + (target - start) * (step / RAMP_STEPS))
        world.step(world.steps(RAMP_SECONDS / RAMP_STEPS))
    world.step(world.steps(DWELL_SECONDS))
    held_q = robot.q
    held_q[RING_JOINTS] = grasp.q[RING_JOINTS]
    return replace(grasp, held_q=held_q, T_hand_held0=body.pose)
