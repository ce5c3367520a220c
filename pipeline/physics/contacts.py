"""Contact impulses of the last physics step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.physics.bodies import Body
from pipeline.physics.robots import Robot
from pipeline.physics.world import World


def link_impulses(world: World, body: Body, robot: Robot) -> dict[str, NDArray[np.float64]]:
    """Return the impulse (3,), N s, world frame, that acted on ``body`` from each touching link in the last step.

    The impulses of all contact points of a link are summed. Links that are near but do not press are left out; while
    everything sleeps the last impulses stay.
    """
    names = robot.link_name_by_component
    total: dict[str, NDArray[np.float64]] = {}
    for contact in world.system.get_contacts():
        first, second = contact.bodies
        if first == body.component and second in names:
            name, sign = names[second], 1.0
        elif second == body.component and first in names:
            name, sign = names[first], -1.0
        else:
            continue
        impulse = sign * np.sum([point.impulse for point in contact.points], axis=0, dtype=np.float64)
        if np.any(impulse):
            total[name] = total.get(name, np.zeros(3)) + impulse
    return total


def pressing_links(world: World, body: Body, robot: Robot, threshold: float) -> set[str]:
    """Return the names of links whose impulse on ``body`` exceeds ``threshold``, N s, in the last step."""
    return {name for name, impulse in link_impulses(world, body, robot).items() if np.linalg.norm(impulse) > threshold}
