"""Phases carried out in physics, and the reasons for which the sequence ends early."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluate.scene import START_ARM, START_HAND, Scene
from pipeline.evaluate.sequence import Phase, Posture
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.poses import inverse_pose, position_quaternion

RELEASED_HEIGHT = 0.1  # m, the released code's criterion
# A pick lifted its object when the object rose by this share of the hand's own lift.
LIFTED_SHARE = 0.5
LOST = 0.05  # m, motion in the hand after which object 0 counts as lost on the way


class Ended(Exception):
    """The sequence cannot go on; the text is the reason."""


@dataclass
class Run:
    """A sequence under way."""

    scene: Scene
    settings: EvaluateParameters
    rest: list[NDArray[np.float64]]  # settled T_world_object of both objects
    posture: Posture = field(default_factory=lambda: Posture(START_ARM.copy(), START_HAND.copy()))  # last targets
    held_pose: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))  # T_hand_object0 before the second pick
    steps: int = 0
    phase: str = "settle"
    snapshots: list[tuple[str, Any, Any, Any]] = field(default_factory=list)
    heights: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))
    push1: float = 0.0
    under_way: str = ""  # phase being carried out
    watch: Callable[[Run], None] | None = None  # called after every control period; looks on and changes nothing

    def settle(self, phase: Phase) -> None:
        """Let the objects come to rest before anything moves."""
        self._follow(phase)
        self.rest = [self.pose(0), self.pose(1)]
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
            if phase.name == "enter second":
                self.push1 = self.push(1)
            self._end_phase(phase.name)
            self._judge(phase.name)

    def _follow(self, phase: Phase) -> None:
        self.under_way = phase.name
        for arm, velocity, hand in zip(phase.arm, phase.arm_velocity, phase.hand, strict=True):
            self._control(arm, hand, velocity)

    def _control(self, arm: NDArray[np.float64], hand: NDArray[np.float64], arm_velocity: NDArray[np.float64]) -> None:
        """Set targets for one control period and let it pass."""
        self.posture = Posture(arm, hand)
        self.scene.robot.set_targets(np.concatenate([arm, hand]), np.concatenate([arm_velocity, np.zeros(16)]))
        count = self.scene.world.settings.frequency // self.settings.control_frequency
        self.scene.world.step(count)
        self.steps += count
        if self.watch:
            self.watch(self)

    def _judge(self, name: str) -> None:
        """End the sequence when the phase just completed did not do what it should."""
        settings = self.settings
        if name == "enter first" and max(self.push(0), self.push(1)) > settings.push_limit:
            raise Ended("collision on approach")
        if name == "lift first" and self.height(0) < LIFTED_SHARE * settings.first_lift_height:
            raise Ended("first slip")
        if name == "open second":
            self.held_pose = self.pose_in_hand()
        if name == "enter second":
            if np.linalg.norm((self.pose_in_hand() - self.held_pose)[:3, 3]) > LOST:
                raise Ended("first lost in transit")
            if self.push1 > settings.push_limit:
                raise Ended("collision on approach")
        if name == "lift second":
            for index, reason in ((0, "first lost in transit"), (1, "second slip")):
                if self.heights[index] < settings.success_height:
                    raise Ended(reason)

    def _hold(self, phase: Phase) -> None:
        self.under_way = phase.name
        lowest = self.heights
        for arm, velocity, hand in zip(phase.arm, phase.arm_velocity, phase.hand, strict=True):
            self._control(arm, hand, velocity)
            lowest = np.minimum(lowest, [self.height(0), self.height(1)])
        self._end_phase(phase.name)
        self.heights = lowest
        if lowest.min() < self.settings.success_height:
            raise Ended("dropped in hold")

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

    def pose_in_hand(self) -> NDArray[np.float64]:
        """``T_hand_object`` (4, 4) of object 0 now."""
        return inverse_pose(_known(self.scene.robot.link_pose("base_link"))) @ self.pose(0)

    def _end_phase(self, phase: str) -> None:
        """Name the phase that was completed and remember what the scene looks like."""
        self.phase = phase
        poses = [np.concatenate(position_quaternion(self.pose(index))) for index in (0, 1)]
        self.snapshots.append((phase, self.scene.robot.q, poses[0], poses[1]))
        self.heights = np.array([self.height(0), self.height(1)])

    def outcome(self, reason: str) -> dict[str, Any]:
        """Return the columns of ``records.tables.TRIALS`` that tell how it went; ``reason`` '' is success."""
        lifted = next((s for s in self.snapshots if s[0] == "lift second"), None)
        rises = [] if lifted is None else [lifted[2 + i][2] - self.rest[i][2, 3] for i in (0, 1)]
        return {
            "phase": self.phase,
            "success": reason == "",
            "success_10cm": bool(rises and min(rises) > RELEASED_HEIGHT),
            "reason": reason,
            "height0": float(self.heights[0]),
            "height1": float(self.heights[1]),
            "push1": self.push1,
            "steps": self.steps,
            "snapshot_phases": [snapshot[0] for snapshot in self.snapshots],
            "snapshot_robot_q": [snapshot[1] for snapshot in self.snapshots],
            "snapshot_pose0": [snapshot[2] for snapshot in self.snapshots],
            "snapshot_pose1": [snapshot[3] for snapshot in self.snapshots],
        }


def _known(T: NDArray[np.float64]) -> NDArray[np.float64]:
    if not np.isfinite(T).all():
        raise Ended("simulation diverged")
    return T
