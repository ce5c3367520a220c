"""Inverse kinematics of the arm: damped least squares from seeded restarts."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pipeline.motion.arm_model import ArmModel

POSITION_TOLERANCE = 2e-4  # m
ROTATION_TOLERANCE = 1e-3  # rad
LEAST_DAMPING = 1e-6
LONGEST_STEP = 0.4  # rad, largest change of one joint per iteration
MOST_SOLUTIONS = 6
SAME_SOLUTION = 0.1  # rad, largest joint difference of solutions that count as one


def solve_from(
    arm: ArmModel,
    T_base_hand: NDArray[np.float64],
    q: NDArray[np.float64],
    iterations: int = 60,
) -> NDArray[np.float64] | None:
    """Return arm joints (7,) within limits that put the hand at a pose, found from one start, or None.

    Damped least squares on the twist in the hand frame; the damping shrinks with the error (Sugihara 2011), so that
    steps are short far from the goal and near singular postures, and Newton's at the end.

    Args:
        T_base_hand: (4, 4) goal.
        q: (7,) start, rad.
    """
    lower, upper, unit = arm.lower, arm.upper, np.eye(6)
    q = np.minimum(np.maximum(q, lower), upper)
    error_at = arm.pose_errors(T_base_hand)
    for _ in range(iterations):
        error, J = error_at(q)
        position, rotation = error[:3], error[3:]
        if math.sqrt(position @ position) < POSITION_TOLERANCE and math.sqrt(rotation @ rotation) < ROTATION_TOLERANCE:
            return q
        step = J.T @ np.linalg.solve(J @ J.T + (0.5 * error @ error + LEAST_DAMPING) * unit, error)
        step *= min(1.0, LONGEST_STEP / max(np.abs(step).max(), 1e-12))
        q = np.minimum(np.maximum(q + step, lower), upper)
    return None


def solve(
    arm: ArmModel,
    T_base_hand: NDArray[np.float64],
    start: NDArray[np.float64],
    rng: np.random.Generator,
    accept: Callable[[NDArray[np.float64]], bool],
    restarts: int = 30,
) -> list[NDArray[np.float64]]:
    """Return a few different accepted solutions (7,), nearest to ``start`` and farthest from limits first.

    Args:
        start: (7,) current joints, also the first guess.
        accept: test of a solution, such as freedom from collisions.
        restarts: number of guesses, the current joints included.
    """
    found: list[NDArray[np.float64]] = []
    for attempt in range(restarts):
        guess = start if attempt == 0 else rng.uniform(arm.lower, arm.upper)
        q = solve_from(arm, T_base_hand, guess)
        if q is None or any(np.abs(q - other).max() < SAME_SOLUTION for other in found) or not accept(q):
            continue
        found.append(q)
        if len(found) == MOST_SOLUTIONS:
            break
    return sorted(found, key=lambda q: preference(arm, q, start))


def preference(arm: ArmModel, q: NDArray[np.float64], start: NDArray[np.float64]) -> float:
    """Cost of a solution, rad: distance from ``start`` minus the smallest distance to a joint limit."""
    return float(np.linalg.norm(q - start) - min((q - arm.lower).min(), (arm.upper - q).min()))
