"""The planner of the arm's moves from one posture to another, by the name that `evaluate.planner` gives."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pipeline.motion.collisions import CollisionWorld
from pipeline.motion.curobo_planner import curobo
from pipeline.motion.paths import plan

# From a world, start (7,) and goal (7,), rad, and a source of samples, to a free path (n, 7) of way-points or None.
Planner = Callable[
    [CollisionWorld, NDArray[np.float64], NDArray[np.float64], np.random.Generator], NDArray[np.float64] | None
]


def own(
    world: CollisionWorld, start: NDArray[np.float64], goal: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64] | None:
    """Return the path of this project's RRT-Connect; equal generators give equal paths."""
    return plan(world.is_free, start, goal, world.arm.lower, world.arm.upper, rng)


def planner(name: str) -> Planner:
    """Return the planner of a name of `evaluate.planner`."""
    return {"own": own, "curobo": curobo}[name]
