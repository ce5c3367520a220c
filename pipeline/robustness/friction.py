"""The lowest friction at which a grasp holds in the test of holding."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pipeline.physics.holding import HeldGrasp, hold_in_gravities
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.validate import ValidateParameters


def lowest_rung(holds: Callable[[float], bool], ladder: Sequence[float]) -> float:
    """Return the lowest of falling frictions at which a grasp holds, infinite where it holds at none.

    Bisection: a grasp that holds at one friction is taken to hold at all larger ones of the ladder, so that six need
    three tests at most.
    """
    held, fails = -1, len(ladder)  # places in the ladder
    while fails - held > 1:
        middle = (held + fails) // 2
        if holds(ladder[middle]):
            held = middle
        else:
            fails = middle
    return ladder[held] if held >= 0 else np.inf


def lowest_friction(
    grasp: HeldGrasp, physics: PhysicsParameters, limits: ValidateParameters, ladder: Sequence[float]
) -> float:
    """Return the lowest friction of every two touching bodies at which a grasp holds in all directions of gravity."""
    early = limits.model_copy(update={"early_rejection": True})

    def holds(friction: float) -> bool:
        limits = early.at_friction(friction)
        held = hold_in_gravities(physics, limits, grasp.objects, grasp.q, grasp.squeeze_q, grasp.hand)
        return held.failed_direction == ""

    return lowest_rung(holds, ladder)
