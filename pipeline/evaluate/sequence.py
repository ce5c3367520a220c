"""The sequence as joint targets, one row per control period; trials and exported plans are made of the same phases.

Phases: open, approach, enter, close and lift for the first object; the same for the second; hold.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluate.grasps import TwoObjectGrasp
from pipeline.evaluate.moves import Pick, PickTask, plan_pick
from pipeline.hand.moves import RING_JOINTS
from pipeline.records.parameters.evaluate import EvaluateParameters

if TYPE_CHECKING:
    from pipeline.motion.collisions import Obstacle
    from pipeline.motion.timing import Trajectory


@dataclass(frozen=True)
class Posture:
    """Joint targets of the whole robot."""

    arm: NDArray[np.float64]  # (7,) rad
    hand: NDArray[np.float64]  # (16,) rad


@dataclass(frozen=True)
class Phase:
    """Targets of one phase; each row is to be reached at the end of its control period."""

    name: str
    arm: NDArray[np.float64]  # (n, 7) rad
    arm_velocity: NDArray[np.float64]  # (n, 7) rad/s
    hand: NDArray[np.float64]  # (n, 16) rad

    @property
    def last(self) -> Posture:
        """Where the next phase begins."""
        return Posture(self.arm[-1], self.hand[-1])


class _Script:
    """Targets written one after the other; every move begins where the one before ended."""

    def __init__(self, start: Posture, settings: EvaluateParameters) -> None:
        self.settings = settings
        self.rows = [(start.arm, np.zeros(7), start.hand)]
        self.phases: list[Phase] = []
        self.written = 1

    def rest_for(self, seconds: float) -> None:
        """Keep all targets."""
        arm, _, hand = self.rows[-1]
        self.rows += [(arm, np.zeros(7), hand)] * round(seconds * self.settings.control_frequency)

    def follow(self, motion: Trajectory) -> None:
        """Move the arm; the hand keeps its targets."""
        hand = self.rows[-1][2]
        self.rows += [(q, v, hand) for q, v in zip(motion.positions[1:], motion.velocities[1:], strict=True)]

    def move_hand(self, target: NDArray[np.float64], seconds: float) -> None:
        """Move the hand's targets evenly to ``target`` (16,); the arm keeps its targets."""
        arm, _, begin = self.rows[-1]
        count = max(round(seconds * self.settings.control_frequency), 1)
        self.rows += [(arm, np.zeros(7), begin + (target - begin) * (index / count)) for index in range(1, count + 1)]

    def close_hand(self, grasp_q: NDArray[np.float64], squeeze_q: NDArray[np.float64]) -> None:
        """Bring all fingers to the grasp at the same time, then squeeze, as validation does; (16,) both."""
        self.move_hand(grasp_q, self.settings.close_seconds / 2)
        self.move_hand(squeeze_q, self.settings.close_seconds / 2)
        self.rest_for(self.settings.dwell_seconds)

    def end_phase(self, name: str) -> None:
        """Name what was written since the last phase ended."""
        own = self.rows[self.written :]
        arm, velocity, hand = (
            np.array([row[part] for row in own]).reshape(-1, width) for part, width in ((0, 7), (1, 7), (2, 16))
        )
        self.phases.append(Phase(name, arm, velocity, hand))
        self.written = len(self.rows)


def with_ring(hand_q: NDArray[np.float64], ring_q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``hand_q`` (16,) with the ring finger of ``ring_q`` (16,)."""
    joined = hand_q.copy()
    joined[RING_JOINTS] = ring_q[RING_JOINTS]
    return joined


def rest_phase(name: str, start: Posture, seconds: float, settings: EvaluateParameters) -> Phase:
    """Return a phase in which nothing is told to move."""
    script = _Script(start, settings)
    script.rest_for(seconds)
    script.end_phase(name)
    return script.phases[0]


def first_phases(start: Posture, grasp: TwoObjectGrasp, pick: Pick, settings: EvaluateParameters) -> list[Phase]:
    """Return the pick of object 0, and the opening of the ring finger after it."""
    script = _Script(start, settings)
    script.move_hand(grasp.open_q0, settings.open_seconds)
    script.end_phase("open first")
    script.follow(pick.approach)
    script.end_phase("approach first")
    script.follow(pick.entry)
    script.rest_for(settings.dwell_seconds)
    script.end_phase("enter first")
    script.close_hand(with_ring(grasp.q, grasp.open_q0), with_ring(grasp.squeeze_q, grasp.open_q0))
    script.end_phase("close first")
    script.follow(pick.lift)
    script.rest_for(settings.dwell_seconds)
    script.end_phase("lift first")
    script.move_hand(with_ring(grasp.squeeze_q, grasp.open_q1), settings.open_seconds)
    script.end_phase("open second")
    return script.phases


def second_phases(start: Posture, grasp: TwoObjectGrasp, pick: Pick, settings: EvaluateParameters) -> list[Phase]:
    """Return the pick of object 1 with object 0 in the hand, and the hold."""
    script = _Script(start, settings)
    script.follow(pick.approach)
    script.end_phase("approach second")
    script.follow(pick.entry)
    script.rest_for(settings.dwell_seconds)
    script.end_phase("enter second")
    script.close_hand(with_ring(grasp.squeeze_q, grasp.q), grasp.squeeze_q)
    script.end_phase("close second")
    script.follow(pick.lift)
    script.rest_for(settings.dwell_seconds)
    script.end_phase("lift second")
    script.rest_for(settings.hold_seconds)
    script.end_phase("hold")
    return script.phases


@dataclass(frozen=True)
class Surroundings:
    """The objects as obstacles where they stand, poses in the world frame, which is the robot's base."""

    first: Obstacle
    second: Obstacle
    others: tuple[Obstacle, ...] = ()  # nothing is done with these


def first_task(
    grasp: TwoObjectGrasp, around: Surroundings, arm_q: NDArray[np.float64], settings: EvaluateParameters
) -> PickTask:
    """Return the pick of object 0 from arm joints (7,)."""
    return PickTask(
        arm_q=arm_q,
        hand_q=grasp.open_q0,
        closed_q=with_ring(grasp.q, grasp.open_q0),
        target=around.first,
        T_hand_target=grasp.T_hand_object0,
        held=(),
        others=(around.second, *around.others),
        direction=around.first.pose[:3, :3] @ grasp.approach_direction0,
        lengths=(settings.entry_length,),
        lift_height=settings.first_lift_height,
    )


def second_task(
    grasp: TwoObjectGrasp,
    around: Surroundings,
    start: Posture,
    T_hand_object0: NDArray[np.float64],
    settings: EvaluateParameters,
) -> PickTask:
    """Return the pick of object 1 with object 0 in the hand.

    Args:
        around: where object 0 stands does not matter any more.
        start: where the robot's joints are.
    """
    own = grasp.approach_length1
    return PickTask(
        arm_q=start.arm,
        hand_q=with_ring(start.hand, grasp.open_q1),
        closed_q=with_ring(start.hand, grasp.q),
        target=around.second,
        T_hand_target=grasp.T_hand_object1,
        held=(around.first.at(T_hand_object0),),
        others=around.others,
        direction=around.second.pose[:3, :3] @ grasp.approach_direction1,
        lengths=(own, *(length for length in settings.shorter_entries if length < own)),
        lift_height=settings.lift_height,
    )


def plan_both(
    grasp: TwoObjectGrasp,
    around: Surroundings,
    arm_q: NDArray[np.float64],
    settings: EvaluateParameters,
    rng: np.random.Generator,
) -> tuple[Pick | None, Pick | None]:
    """Plan both picks before anything moves, the second as if the first went perfectly; None for what has no plan."""
    first = plan_pick(first_task(grasp, around, arm_q, settings), settings, rng)
    if first is None:
        return None, None
    held = Posture(first.lift.positions[-1], grasp.q)
    return first, plan_pick(second_task(grasp, around, held, grasp.T_hand_object0, settings), settings, rng)
