"""The sequence as joint targets, one row per control period; trials and exported plans are made of the same phases.

Phases: open, approach, enter, close and lift for the first object; the same for every further one; hold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluate.grasps import SequenceGrasp
from pipeline.evaluate.moves import Pick, PickTask, plan_pick
from pipeline.hand.model import Hand
from pipeline.records.ordinals import ORDINALS
from pipeline.records.parameters.evaluate import EvaluateParameters

if TYPE_CHECKING:
    from pipeline.motion.collisions import Obstacle
    from pipeline.motion.timing import Trajectory


@dataclass(frozen=True)
class Posture:
    """Joint targets of the whole robot."""

    arm: NDArray[np.float64]  # (7,) rad
    hand: NDArray[np.float64]  # (J,) rad


@dataclass(frozen=True)
class Phase:
    """Targets of one phase; each row is to be reached at the end of its control period."""

    name: str
    arm: NDArray[np.float64]  # (n, 7) rad
    arm_velocity: NDArray[np.float64]  # (n, 7) rad/s
    hand: NDArray[np.float64]  # (n, J) rad

    @property
    def last(self) -> Posture:
        """Where the next phase begins."""
        return Posture(self.arm[-1], self.hand[-1])


class _Script:
    """Targets written one after the other; every move begins where the one before ended."""

    def __init__(self, start: Posture, settings: EvaluateParameters) -> None:
        self.settings = settings
        self.rows = [(start.arm, np.zeros_like(start.arm), start.hand)]
        self.phases: list[Phase] = []
        self.written = 1

    def rest_for(self, seconds: float) -> None:
        """Keep all targets."""
        arm, _, hand = self.rows[-1]
        self.rows += [(arm, np.zeros_like(arm), hand)] * round(seconds * self.settings.control_frequency)

    def follow(self, motion: Trajectory) -> None:
        """Move the arm; the hand keeps its targets."""
        hand = self.rows[-1][2]
        self.rows += [(q, v, hand) for q, v in zip(motion.positions[1:], motion.velocities[1:], strict=True)]

    def move_hand(self, target: NDArray[np.float64], seconds: float) -> None:
        """Move the hand's targets evenly to ``target`` (J,); the arm keeps its targets."""
        arm, _, begin = self.rows[-1]
        count = max(round(seconds * self.settings.control_frequency), 1)
        still = np.zeros_like(arm)
        self.rows += [(arm, still, begin + (target - begin) * (index / count)) for index in range(1, count + 1)]

    def close_hand(self, grasp_q: NDArray[np.float64], squeeze_q: NDArray[np.float64]) -> None:
        """Bring all fingers to the grasp at the same time, then squeeze, as validation does; (J,) both."""
        self.move_hand(grasp_q, self.settings.close_seconds / 2)
        self.move_hand(squeeze_q, self.settings.close_seconds / 2)
        self.rest_for(self.settings.dwell_seconds)

    def end_phase(self, name: str) -> None:
        """Name what was written since the last phase ended."""
        own = self.rows[self.written :]
        arm, velocity, hand = (
            np.array([row[part] for row in own]).reshape(-1, len(self.rows[0][part])) for part in range(3)
        )
        self.phases.append(Phase(name, arm, velocity, hand))
        self.written = len(self.rows)


def with_joints(
    hand_q: NDArray[np.float64], joints: NDArray[np.int64], other_q: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return ``hand_q`` (J,) with some joints (k,) as in ``other_q`` (J,)."""
    joined = hand_q.copy()
    joined[joints] = other_q[joints]
    return joined


def _joints_from(grasp: SequenceGrasp, pick: int) -> NDArray[np.int64]:
    """Joints of the fingers of the objects from number ``pick`` on: those that hold nothing before it is picked."""
    return np.concatenate([np.zeros(0, np.int64), *(own.joints for own in grasp.picks[pick:])])


def rest_phase(name: str, start: Posture, seconds: float, settings: EvaluateParameters) -> Phase:
    """Return a phase in which all targets stay as they are."""
    script = _Script(start, settings)
    script.rest_for(seconds)
    script.end_phase(name)
    return script.phases[0]


def pick_phases(
    number: int, start: Posture, grasp: SequenceGrasp, pick: Pick, settings: EvaluateParameters
) -> list[Phase]:
    """Return the pick of one object with those before it in the hand.

    Fingers open before the first pick and after every pick but the last, which is followed by the hold.
    """
    script, own = _Script(start, settings), grasp.picks[number]
    ordinal, waiting = ORDINALS[number], _joints_from(grasp, number + 1)
    if number == 0:
        script.move_hand(own.open_q, settings.open_seconds)
        script.end_phase(f"open {ordinal}")
    script.follow(pick.approach)
    script.end_phase(f"approach {ordinal}")
    script.follow(pick.entry)
    script.rest_for(settings.dwell_seconds)
    script.end_phase(f"enter {ordinal}")
    squeezing = with_joints(grasp.squeeze_q, waiting, own.open_q)
    closed = with_joints(squeezing, _joints_from(grasp, number), grasp.q) if number else grasp.q
    script.close_hand(with_joints(closed, waiting, own.open_q), squeezing)
    script.end_phase(f"close {ordinal}")
    script.follow(pick.lift)
    script.rest_for(settings.dwell_seconds)
    script.end_phase(f"lift {ordinal}")
    if number + 1 < len(grasp.picks):
        following = grasp.picks[number + 1]
        script.move_hand(with_joints(grasp.squeeze_q, waiting, following.open_q), settings.open_seconds)
        script.end_phase(f"open {ORDINALS[number + 1]}")
    else:
        script.rest_for(settings.hold_seconds)
        script.end_phase("hold")
    return script.phases


@dataclass(frozen=True)
class Surroundings:
    """The objects as obstacles where they stand, poses in the world frame, which is the robot's base."""

    objects: tuple[Obstacle, ...]  # in the order of picking
    others: tuple[Obstacle, ...] = ()  # nothing is done with these

    def moved(self, number: int, pose: NDArray[np.float64]) -> Surroundings:
        """Return the same with one object elsewhere, ``T_world_object`` (4, 4)."""
        objects = tuple(item.at(pose) if index == number else item for index, item in enumerate(self.objects))
        return replace(self, objects=objects)


def pick_task(
    number: int,
    grasp: SequenceGrasp,
    hand: Hand,
    around: Surroundings,
    start: Posture,
    T_hand_held: Sequence[NDArray[np.float64]],
    settings: EvaluateParameters,
) -> PickTask:
    """Return the pick of one object with those before it in the hand.

    Args:
        around: where the objects in the hand stood does not matter any more.
        start: where the robot's joints are.
        T_hand_held: ``T_hand_object`` (4, 4) of the objects in the hand.
    """
    own, target = grasp.picks[number], around.objects[number]
    waiting = _joints_from(grasp, number + 1)
    lengths: tuple[float, ...] = (settings.entry_length,)
    hand_q, closed_q = own.open_q, grasp.q
    if number:
        free = _joints_from(grasp, number)
        hand_q, closed_q = with_joints(start.hand, free, own.open_q), with_joints(start.hand, free, grasp.q)
    if own.approach_length is not None:
        full = own.approach_length
        lengths = (full, *(length for length in settings.shorter_entries if length < full))
    last = number == len(grasp.picks) - 1
    return PickTask(
        hand=hand,
        arm_q=start.arm,
        hand_q=hand_q,
        closed_q=with_joints(closed_q, waiting, own.open_q),
        target=target,
        T_hand_target=own.T_hand_object,
        held=tuple(item.at(T) for item, T in zip(around.objects[:number], T_hand_held, strict=True)),
        others=(*around.objects[number + 1 :], *around.others),
        direction=target.pose[:3, :3] @ own.approach_direction,
        lengths=lengths,
        lift_height=settings.lift_height if last else settings.first_lift_height,
    )


def plan_all(
    grasp: SequenceGrasp,
    hand: Hand,
    around: Surroundings,
    start: Posture,
    settings: EvaluateParameters,
    rng: np.random.Generator,
) -> list[Pick]:
    """Plan all picks before anything moves, each as if those before it went perfectly.

    The list ends before the first pick that has no plan.
    """
    picks: list[Pick] = []
    for number in range(len(grasp.picks)):
        held = [own.T_hand_object for own in grasp.picks[:number]]
        pick = plan_pick(pick_task(number, grasp, hand, around, start, held, settings), settings, rng)
        if pick is None:
            break
        picks.append(pick)
        start = Posture(pick.lift.positions[-1], grasp.q)
    return picks
