"""Phases carried out in physics, and the reasons for which the sequence ends early."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluate.disturbance import TrialDisturbance, believed_pose
from pipeline.evaluate.scene import START_ARM, Scene
from pipeline.evaluate.sequence import Phase, Posture
from pipeline.records.ordinals import ORDINALS
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.poses import inverse_pose, position_quaternion
from pipeline.records.trial_reasons import TrialReason

RELEASED_HEIGHT = 0.1  # m, the released code's criterion
# A pick lifted its object when the object rose by this share of the hand's own lift.
LIFTED_SHARE = 0.5
LOST = 0.05  # m, motion in the hand after which a held object counts as lost on the way


class Ended(Exception):
    """The sequence cannot go on."""

    def __init__(self, reason: TrialReason) -> None:
        super().__init__(reason.value)
        self.reason = reason


@dataclass
class Run:
    """A sequence under way."""

    scene: Scene
    settings: EvaluateParameters
    rest: list[NDArray[np.float64]]  # settled T_world_object of the objects, in the order of picking
    posture: Posture = field(init=False)  # last targets
    held_poses: list[NDArray[np.float64]] = field(default_factory=list)  # T_hand_object before the current pick
    steps: int = 0
    phase: str = "settle"
    snapshots: list[tuple[str, Any, list[Any]]] = field(default_factory=list)  # phase, robot's joints, object poses
    heights: NDArray[np.float64] = field(init=False)  # (n,) m
    pushes: NDArray[np.float64] = field(init=False)  # (n,) m, of objects before their fingers close
    under_way: str = ""  # phase being carried out
    watch: Callable[[Run], None] | None = None  # called after every control period; looks on and changes nothing
    disturbance: TrialDisturbance | None = None
    _late: deque[tuple[Any, Any]] = field(default_factory=deque)  # targets and their velocities on their way

    def __post_init__(self) -> None:
        self.posture = Posture(START_ARM.copy(), self.scene.hand.start.copy())
        self.heights, self.pushes = np.zeros(self.count), np.zeros(self.count)

    @property
    def count(self) -> int:
        """How many objects there are."""
        return len(self.scene.objects)

    def settle(self, phase: Phase) -> None:
        """Let the objects come to rest before anything moves."""
        self._follow(phase)
        self.rest = [self.pose(index) for index in range(self.count)]
        self._end_phase(phase.name)

    def execute(self, phases: Sequence[Phase]) -> None:
        """Carry out phases one after the other and judge each.

        Raises:
            Ended: a phase did not do what it should.
        """
        for phase in phases:
            if phase.name == "hold":
                self._hold(phase)
                continue
            self._follow(phase)
            name, ordinal = phase.name.split()
            number = ORDINALS.index(ordinal)
            if name == "enter":
                self.pushes[number] = self.push(number)
            self._end_phase(phase.name)
            self._judge(name, number)

    def _follow(self, phase: Phase, after_each: Callable[[], None] = lambda: None) -> None:
        """Carry out the control periods of a phase.

        Args:
            after_each: called after every control period.
        """
        self.under_way = phase.name
        shoves = self._shoves(phase)
        for period, (arm, velocity, hand) in enumerate(zip(phase.arm, phase.arm_velocity, phase.hand, strict=True)):
            self.posture = Posture(arm, hand)
            self._send(np.concatenate([arm, hand]), np.concatenate([velocity, np.zeros_like(hand)]))
            self._pass(shoves.get(period, ()))
            after_each()

    def _send(self, q: NDArray[np.float64], velocity: NDArray[np.float64]) -> None:
        """Give the drives targets (R,), rad and rad/s, or those sent as many control periods ago as they are late."""
        if self.disturbance is None:
            self.scene.robot.set_targets(q, velocity)
            return
        self._late.append((q - self.disturbance.joint_errors, velocity))
        if len(self._late) > self.disturbance.latency:
            self.scene.robot.set_targets(*self._late.popleft())

    def _shoves(self, phase: Phase) -> dict[int, NDArray[np.float64]]:
        """Return the forces (k, 3), N, on the first k objects, which are in the hand, by control period of a phase."""
        name, _, ordinal = phase.name.partition(" ")
        carried = {"approach": ORDINALS.index(ordinal) if ordinal else 0, "hold": self.count}.get(name, 0)
        if self.disturbance is None or not carried:
            return {}
        length = round(self.disturbance.shove_seconds * self.settings.control_frequency)
        begin = len(phase.arm) // 2
        return dict.fromkeys(range(begin, begin + max(length, 1)), self.disturbance.shoves[:carried])

    def _pass(self, shoves: Sequence[NDArray[np.float64]] | NDArray[np.float64]) -> None:
        """Let one control period pass, with forces (3,), N, on the first objects."""
        count = self.scene.world.frequency // self.settings.control_frequency
        if len(shoves):
            for _ in range(count):
                for body, force in zip(self.scene.objects, shoves, strict=False):
                    body.push(force)
                self.scene.world.step()
        else:
            self.scene.world.step(count)
        self.steps += count
        if self.watch:
            self.watch(self)

    def _judge(self, name: str, number: int) -> None:
        """End the sequence when the phase of one pick just completed did not do what it should."""
        settings = self.settings
        last = number == self.count - 1
        if name == "open":
            self.held_poses = [self.pose_in_hand(index) for index in range(number)]
        if name == "enter":
            for index in range(number):
                if np.linalg.norm((self.pose_in_hand(index) - self.held_poses[index])[:3, 3]) > LOST:
                    raise Ended(_lost(index))
            if max(self.push(index) for index in range(number, self.count)) > settings.push_limit:
                raise Ended(TrialReason.COLLISION_ON_APPROACH)
        if name == "lift" and not last and self.height(number) < LIFTED_SHARE * settings.first_lift_height:
            raise Ended(_slip(number))
        if name == "lift" and last:
            for index, height in enumerate(self.heights):
                if height < settings.success_height:
                    raise Ended(_slip(number) if index == number else _lost(index))

    def _hold(self, phase: Phase) -> None:
        lowest = self.heights

        def look() -> None:
            nonlocal lowest
            lowest = np.minimum(lowest, [self.height(index) for index in range(self.count)])

        self._follow(phase, look)
        self._end_phase(phase.name)
        self.heights = lowest
        if lowest.min() < self.settings.success_height:
            raise Ended(TrialReason.DROPPED)

    def pose(self, index: int) -> NDArray[np.float64]:
        """``T_world_object`` (4, 4) of one object now.

        Raises:
            Ended: physics has lost it; a pose that is not a number would pass every comparison.
        """
        return _known(self.scene.objects[index].pose)

    def height(self, index: int) -> float:
        """Height of an object's centre of mass over where it rested, m."""
        return float(self.pose(index)[2, 3] - self.rest[index][2, 3])

    def push(self, index: int) -> float:
        """How far an object is from where it rested, m."""
        return float(np.linalg.norm(self.pose(index)[:3, 3] - self.rest[index][:3, 3]))

    def pose_in_hand(self, index: int) -> NDArray[np.float64]:
        """``T_hand_object`` (4, 4) of one object now."""
        return inverse_pose(self._hand_pose()) @ self.pose(index)

    def _hand_pose(self) -> NDArray[np.float64]:
        return _known(self.scene.robot.link_pose(self.scene.hand.link_names[0]))

    def measured_posture(self) -> Posture:
        """Commanded joints of the arm, and where the hand's joints are measured."""
        q, arm = self.scene.robot.q, len(self.posture.arm)
        errors = 0.0 if self.disturbance is None else self.disturbance.joint_errors
        return Posture(self.posture.arm, (q + errors)[arm:])

    def believed_pose(self, index: int, resting: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        """``T_world_object`` (4, 4) of one object as the robot believes it to be now.

        Args:
            resting: (V, 3) vertices of an object that rests on something, whose height is known.
        """
        if self.disturbance is None:
            return self.pose(index)
        errors = self.disturbance.position_errors[index], self.disturbance.rotation_errors[index]
        return believed_pose(self.pose(index), *errors, resting)

    def believed_in_hand(self, index: int) -> NDArray[np.float64]:
        """``T_hand_object`` (4, 4) of one held object as the robot believes it to be now."""
        return inverse_pose(self._hand_pose()) @ self.believed_pose(index)

    def _end_phase(self, phase: str) -> None:
        """Name the phase that was completed and remember what the scene looks like."""
        self.phase = phase
        poses = [np.concatenate(position_quaternion(self.pose(index))) for index in range(self.count)]
        self.snapshots.append((phase, self.scene.robot.q, poses))
        self.heights = np.array([self.height(index) for index in range(self.count)])

    def outcome(self, reason: TrialReason | None) -> dict[str, Any]:
        """Return how it went, as columns of ``records.tables.TRIALS``; without a ``reason`` it is a success."""
        lifted = next((s for s in self.snapshots if s[0] == f"lift {ORDINALS[self.count - 1]}"), None)
        rises = [] if lifted is None else [p[2] - T[2, 3] for p, T in zip(lifted[2], self.rest, strict=True)]
        return {
            "phase": self.phase,
            "success": reason is None,
            "success_10cm": bool(rises and min(rises) > RELEASED_HEIGHT),
            "reason": "" if reason is None else reason.value,
            "heights": self.heights.tolist(),
            "pushes": self.pushes.tolist(),
            "steps": self.steps,
            "snapshot_phases": [snapshot[0] for snapshot in self.snapshots],
            "snapshot_robot_q": [snapshot[1] for snapshot in self.snapshots],
            "snapshot_poses": [[snapshot[2][index] for snapshot in self.snapshots] for index in range(self.count)],
        }


def _slip(number: int) -> TrialReason:
    return TrialReason[f"{ORDINALS[number]}_slip".upper()]


def _lost(number: int) -> TrialReason:
    return TrialReason[f"{ORDINALS[number]}_lost".upper()]


def _known(T: NDArray[np.float64]) -> NDArray[np.float64]:
    if not np.isfinite(T).all():
        raise Ended(TrialReason.DIVERGED)
    return T
