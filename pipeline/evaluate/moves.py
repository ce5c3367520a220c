"""The arm's moves of a pick: to a pre-grasp, straight in, straight up; found before the arm begins to move."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluate.scene import support_obstacles
from pipeline.hand.model import Hand
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.poses import inverse_pose

if TYPE_CHECKING:
    from pipeline.motion.arm_model import ArmModel
    from pipeline.motion.collisions import CollisionWorld, Obstacle
    from pipeline.motion.timing import Trajectory

# Grasps touch the sponge within a millimetre; lines that begin or end there plan with a lower one.
SPONGE_DROP = 0.004  # m
# Shares of the arm's velocity and acceleration limits: free moves of the empty hand, free moves with an object held,
# straight lines. Harder accelerations shake barely held objects off.
FREE_SHARE = (0.5, 0.5)
HELD_SHARE = (0.5, 0.15)
LINE_SHARE = (0.3, 0.1)
APPROACH_WORLDS = 3
SPLINE_SPACINGS = (0.15, 0.05)  # rad; the finer one follows the path more closely


@dataclass(frozen=True)
class Pick:
    """Three moves, each beginning where the one before ended."""

    approach: Trajectory
    entry: Trajectory
    lift: Trajectory


@dataclass(frozen=True)
class PickTask:
    """What a pick has to do; poses in the world frame, which is the robot's base.

    Attributes:
        hand: the hand on the arm.
        arm_q: (7,) where the arm is.
        hand_q: (J,) posture during approach and entry.
        closed_q: (J,) posture of the lift.
        target: the object to grasp, where it stands.
        T_hand_target: (4, 4) its pose in the hand when grasped.
        held: what the hand holds already, with ``T_hand_object``.
        others: obstacles besides table, sponge and target.
        direction: (3,) unit vector from the grasp to where the hand comes from.
        lengths: entry lengths to try in this order, m.
        lift_height: m.
    """

    hand: Hand
    arm_q: NDArray[np.float64]
    hand_q: NDArray[np.float64]
    closed_q: NDArray[np.float64]
    target: Obstacle
    T_hand_target: NDArray[np.float64]
    held: tuple[Obstacle, ...]
    others: tuple[Obstacle, ...]
    direction: NDArray[np.float64]
    lengths: tuple[float, ...]
    lift_height: float


class _Worlds:
    """Collision worlds of one pick."""

    def __init__(self, task: PickTask, settings: EvaluateParameters) -> None:
        from pipeline.motion.arm_model import ArmModel
        from pipeline.motion.collisions import CollisionWorld

        low, high = support_obstacles(settings, SPONGE_DROP), support_obstacles(settings, 0.0)
        others, held, name = [*task.others], [*task.held], task.target.name
        self.arm: ArmModel = ArmModel(task.hand_q, task.hand)

        @cache
        def approach(place: int) -> CollisionWorld:
            # Clearance first; then touching; then a sponge so low that resting fingers are not in it.
            supports, margin = ((high, settings.planning_margin), (high, 0.0), (low, 0.0))[place]
            return CollisionWorld(self.arm, [*supports, *others, task.target], held, margin=margin)

        self.approach: Callable[[int], CollisionWorld] = approach  # made when they are needed
        self.entry = CollisionWorld(self.arm, [*low, *others, task.target], held, allowed=[name])
        grasped = task.target.at(task.T_hand_target)
        self.lift = CollisionWorld(ArmModel(task.closed_q, task.hand), [*low, *others], [*held, grasped])


def plan_pick(task: PickTask, settings: EvaluateParameters, rng: np.random.Generator) -> Pick | None:
    """Return the moves of a pick, or None when no solution of the inverse kinematics carries all of them.

    Args:
        rng: source of restarts and samples; equal generators give equal moves.
    """
    from pipeline.motion.inverse_kinematics import solve
    from pipeline.motion.paths import hand_line

    worlds = _Worlds(task, settings)
    T_base_hand = task.target.pose @ inverse_pose(task.T_hand_target)
    solutions = solve(
        worlds.arm, T_base_hand, task.arm_q, rng, lambda q: worlds.entry.is_free(q) and worlds.lift.is_free(q)
    )

    @cache
    def lift_of(number: int) -> NDArray[np.float64] | None:
        return hand_line(worlds.arm, solutions[number], [0.0, 0.0, task.lift_height], worlds.lift.is_free)

    for length in task.lengths:
        for number, q in enumerate(solutions):
            lift = lift_of(number)
            back = None if lift is None else hand_line(worlds.arm, q, length * task.direction, worlds.entry.is_free)
            if lift is None or back is None:
                continue
            pick = _timed(task, worlds, back[::-1].copy(), lift, settings, rng)
            if pick is not None:
                return pick
    return None


def _timed(
    task: PickTask,
    worlds: _Worlds,
    entry: NDArray[np.float64],
    lift: NDArray[np.float64],
    settings: EvaluateParameters,
    rng: np.random.Generator,
) -> Pick | None:
    from pipeline.motion.timing import time_path

    approach = _approach(task, worlds, entry[0], settings, rng)
    if approach is None:
        return None
    frequency = settings.control_frequency
    timed_entry = time_path(worlds.arm, entry, frequency, *LINE_SHARE)
    timed_lift = time_path(worlds.arm, lift, frequency, *LINE_SHARE)
    if timed_entry is None or timed_lift is None:
        return None
    return Pick(approach, timed_entry, timed_lift)


def _approach(
    task: PickTask, worlds: _Worlds, goal: NDArray[np.float64], settings: EvaluateParameters, rng: np.random.Generator
) -> Trajectory | None:
    """Return a move to ``goal`` (7,) whose samples are free, in the first world that has one."""
    from pipeline.motion.planners import planner
    from pipeline.motion.timing import time_path

    find = planner(settings.planner)
    arm, share = worlds.arm, HELD_SHARE if task.held else FREE_SHARE
    for place in range(APPROACH_WORLDS):
        world = worlds.approach(place)
        path = find(world, task.arm_q, goal, rng)
        if path is None:
            continue
        for spacing in SPLINE_SPACINGS:
            motion = time_path(arm, path, settings.control_frequency, *share, spacing=spacing)
            if motion is not None and worlds.approach(APPROACH_WORLDS - 1).all_free(motion.positions):
                return motion
    return None
