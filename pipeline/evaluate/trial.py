"""One trial: pick the first object with the pinching fingers, keep it, pick the second with ring finger and palm.

The result depends on the inputs alone: every trial has its own physics scene and its own random generator.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluate.grasps import TwoObjectGrasp, grasp_orders
from pipeline.evaluate.moves import Pick, PickTask, plan_pick
from pipeline.evaluate.scene import START_ARM, START_HAND, Scene, build_scene, object_obstacle, placement_offsets
from pipeline.hand.moves import RING_JOINTS
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.poses import inverse_pose, position_quaternion
from pipeline.records.seeds import item_generator, item_seed

if TYPE_CHECKING:
    from pipeline.motion.collisions import Obstacle
    from pipeline.motion.timing import Trajectory

RELEASED_HEIGHT = 0.1  # m, the released code's criterion
# A pick lifted its object when the object rose by this share of the hand's own lift.
LIFTED_SHARE = 0.5
LOST = 0.05  # m, motion in the hand after which object 0 counts as lost on the way


@dataclass(frozen=True)
class TrialInput:
    """All that a trial depends on."""

    trial: int
    source: str
    objects: tuple[PreparedObject, PreparedObject]
    grasps: tuple[TwoObjectGrasp, ...]  # in the order in which they are tried
    settings: EvaluateParameters
    physics: PhysicsParameters
    seed: int


class _Ended(Exception):
    """The trial cannot go on; the text is the reason."""


@dataclass
class _Run:
    """A trial under way."""

    scene: Scene
    settings: EvaluateParameters
    rest: list[NDArray[np.float64]]  # settled T_world_object of both objects
    arm: NDArray[np.float64] = field(default_factory=START_ARM.copy)  # (7,) last target
    hand: NDArray[np.float64] = field(default_factory=START_HAND.copy)  # (16,) last target
    steps: int = 0
    phase: str = "settle"
    snapshots: list[tuple[str, Any, Any, Any]] = field(default_factory=list)
    heights: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))
    push1: float = 0.0

    def control(self, arm: NDArray[np.float64], hand: NDArray[np.float64], arm_velocity: NDArray[np.float64]) -> None:
        """Set targets for one control period and let it pass."""
        self.arm, self.hand = arm, hand
        self.scene.robot.set_targets(np.concatenate([arm, hand]), np.concatenate([arm_velocity, np.zeros(16)]))
        count = self.scene.world.settings.frequency // self.settings.control_frequency
        self.scene.world.step(count)
        self.steps += count

    def rest_for(self, seconds: float) -> None:
        """Keep all targets."""
        for _ in range(round(seconds * self.settings.control_frequency)):
            self.control(self.arm, self.hand, np.zeros(7))

    def follow(self, motion: Trajectory) -> None:
        """Move the arm; the hand keeps its targets."""
        for position, velocity in zip(motion.positions[1:], motion.velocities[1:], strict=True):
            self.control(position, self.hand, velocity)

    def move_hand(self, target: NDArray[np.float64], seconds: float) -> None:
        """Move the hand's targets evenly to ``target`` (16,); the arm keeps its targets."""
        begin, count = self.hand, max(round(seconds * self.settings.control_frequency), 1)
        for index in range(1, count + 1):
            self.control(self.arm, begin + (target - begin) * (index / count), np.zeros(7))

    def close_hand(self, grasp_q: NDArray[np.float64], squeeze_q: NDArray[np.float64]) -> None:
        """Bring all fingers to the grasp at the same time, then squeeze, as validation does; (16,) both."""
        self.move_hand(grasp_q, self.settings.close_seconds / 2)
        self.move_hand(squeeze_q, self.settings.close_seconds / 2)
        self.rest_for(self.settings.dwell_seconds)

    def pose(self, index: int) -> NDArray[np.float64]:
        """``T_world_object`` (4, 4) of one object now.

        Raises:
            _Ended: physics has lost it; a pose that is not a number would pass every comparison below.
        """
        return _known(self.scene.objects[index].pose)

    def height(self, index: int) -> float:
        """Height of an object's centre of mass over where it rested, m."""
        return float(self.pose(index)[2, 3] - self.rest[index][2, 3])

    def push(self, index: int) -> float:
        """How far an object is from where it rested, m."""
        return float(np.linalg.norm(self.pose(index)[:3, 3] - self.rest[index][:3, 3]))

    def held_pose(self) -> NDArray[np.float64]:
        """``T_hand_object`` (4, 4) of object 0 now."""
        return inverse_pose(_known(self.scene.robot.link_pose("base_link"))) @ self.pose(0)

    def end_phase(self, phase: str) -> None:
        """Name the phase that was completed and remember what the scene looks like."""
        self.phase = phase
        poses = [np.concatenate(position_quaternion(self.pose(index))) for index in (0, 1)]
        self.snapshots.append((phase, self.scene.robot.q, poses[0], poses[1]))
        self.heights = np.array([self.height(0), self.height(1)])


def _known(T: NDArray[np.float64]) -> NDArray[np.float64]:
    if not np.isfinite(T).all():
        raise _Ended("simulation diverged")
    return T


def _with_ring(hand_q: NDArray[np.float64], ring_q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``hand_q`` (16,) with the ring finger of ``ring_q`` (16,)."""
    joined = hand_q.copy()
    joined[RING_JOINTS] = ring_q[RING_JOINTS]
    return joined


def _first_task(grasp: TwoObjectGrasp, obstacles: tuple[Obstacle, Obstacle], run: _Run) -> PickTask:
    """The pick of object 0 from where everything is now."""
    T = run.pose(0)
    return PickTask(
        arm_q=run.arm,
        hand_q=grasp.open_q0,
        closed_q=_with_ring(grasp.q, grasp.open_q0),
        target=obstacles[0].at(T),
        T_hand_target=grasp.T_hand_object0,
        held=(),
        others=(obstacles[1].at(run.pose(1)),),
        direction=T[:3, :3] @ grasp.approach_direction0,
        lengths=(run.settings.entry_length,),
        lift_height=run.settings.first_lift_height,
    )


def _second_task(
    grasp: TwoObjectGrasp,
    obstacles: tuple[Obstacle, Obstacle],
    run: _Run,
    arm_q: NDArray[np.float64],
    hand_q: NDArray[np.float64],
    T_hand_object0: NDArray[np.float64],
) -> PickTask:
    """The pick of object 1 with object 0 in the hand; ``hand_q`` (16,) is where the hand's joints are."""
    T = run.pose(1)
    own = grasp.approach_length1
    return PickTask(
        arm_q=arm_q,
        hand_q=_with_ring(hand_q, grasp.open_q1),
        closed_q=_with_ring(hand_q, grasp.q),
        target=obstacles[1].at(T),
        T_hand_target=grasp.T_hand_object1,
        held=(obstacles[0].at(T_hand_object0),),
        others=(),
        direction=T[:3, :3] @ grasp.approach_direction1,
        lengths=(own, *(length for length in run.settings.shorter_entries if length < own)),
        lift_height=run.settings.lift_height,
    )


def _choose(
    inputs: TrialInput, run: _Run, obstacles: tuple[Obstacle, Obstacle], rng: np.random.Generator
) -> tuple[TwoObjectGrasp | None, Pick | None, int, str]:
    """Return the first grasp for which both picks can be planned, its first pick, the attempts made, and a reason.

    The reason is ``no grasp`` when the pair has none, else the pick that could not be planned for any of them.

    Planning alone decides, before anything has moved; no grasp is tried in physics here. The second pick is planned
    as if the first went perfectly, and again later from what is measured.
    """
    reason = "plan first" if inputs.grasps else "no grasp"
    for attempt, grasp in enumerate(inputs.grasps, start=1):
        first = plan_pick(_first_task(grasp, obstacles, run), inputs.settings, rng)
        if first is None:
            continue
        reason = "plan second"
        lifted = first.lift.positions[-1]
        second = plan_pick(
            _second_task(grasp, obstacles, run, lifted, grasp.q, grasp.T_hand_object0), inputs.settings, rng
        )
        if second is not None:
            return grasp, first, attempt, ""
    return None, None, len(inputs.grasps), reason


def _pick_first(run: _Run, grasp: TwoObjectGrasp, pick: Pick) -> None:
    settings = run.settings
    run.move_hand(grasp.open_q0, settings.open_seconds)
    run.end_phase("open first")
    run.follow(pick.approach)
    run.end_phase("approach first")
    run.follow(pick.entry)
    run.rest_for(settings.dwell_seconds)
    run.end_phase("enter first")
    if max(run.push(0), run.push(1)) > settings.push_limit:
        raise _Ended("collision on approach")
    run.close_hand(_with_ring(grasp.q, grasp.open_q0), _with_ring(grasp.squeeze_q, grasp.open_q0))
    run.end_phase("close first")
    run.follow(pick.lift)
    run.rest_for(settings.dwell_seconds)
    run.end_phase("lift first")
    if run.height(0) < LIFTED_SHARE * settings.first_lift_height:
        raise _Ended("first slip")


def _pick_second(
    run: _Run, grasp: TwoObjectGrasp, obstacles: tuple[Obstacle, Obstacle], rng: np.random.Generator
) -> None:
    settings = run.settings
    run.move_hand(_with_ring(grasp.squeeze_q, grasp.open_q1), settings.open_seconds)
    run.end_phase("open second")
    T_hand_object0 = run.held_pose()
    task = _second_task(grasp, obstacles, run, run.arm, run.scene.robot.q[7:], T_hand_object0)
    pick = plan_pick(task, settings, rng)
    if pick is None:
        raise _Ended("plan second")
    run.follow(pick.approach)
    run.end_phase("approach second")
    run.follow(pick.entry)
    run.rest_for(settings.dwell_seconds)
    run.push1 = run.push(1)
    run.end_phase("enter second")
    if np.linalg.norm((run.held_pose() - T_hand_object0)[:3, 3]) > LOST:
        raise _Ended("first lost in transit")
    if run.push1 > settings.push_limit:
        raise _Ended("collision on approach")
    run.close_hand(_with_ring(grasp.squeeze_q, grasp.q), grasp.squeeze_q)
    run.end_phase("close second")
    run.follow(pick.lift)
    run.rest_for(settings.dwell_seconds)
    run.end_phase("lift second")


def _hold(run: _Run) -> None:
    settings = run.settings
    for index, reason in ((0, "first lost in transit"), (1, "second slip")):
        if run.heights[index] < settings.success_height:
            raise _Ended(reason)
    lowest = run.heights
    for _ in range(round(settings.hold_seconds * settings.control_frequency)):
        run.rest_for(1 / settings.control_frequency)
        lowest = np.minimum(lowest, [run.height(0), run.height(1)])
    run.end_phase("hold")
    run.heights = lowest
    if lowest.min() < settings.success_height:
        raise _Ended("dropped in hold")


def run_trial(inputs: TrialInput) -> dict[str, Any]:
    """Run one trial and return its row of ``records.tables.TRIALS``.

    Phases: settle; open, approach, enter, close, lift the first object; the same for the second; hold. A reason ends
    the trial: ``no grasp`` (the pair has no merged grasp), ``plan first``, ``plan second``, ``collision on approach``,
    ``first slip``, ``first lost in transit``, ``second slip``, ``dropped in hold``, ``simulation diverged``.
    """
    rng = np.random.Generator(np.random.PCG64(inputs.seed))
    offsets = placement_offsets(inputs.settings, rng)
    scene = build_scene(inputs.objects, inputs.settings, inputs.physics, offsets)
    run = _Run(scene, inputs.settings, rest=[body.pose for body in scene.objects])
    obstacles = (object_obstacle(inputs.objects[0], "object0"), object_obstacle(inputs.objects[1], "object1"))
    grasp, attempts = None, 0
    try:
        run.rest_for(inputs.settings.settle_seconds)
        run.rest = [run.pose(0), run.pose(1)]
        run.end_phase("settle")
        grasp, pick, attempts, reason = _choose(inputs, run, obstacles, rng)
        if grasp is not None and pick is not None:
            _pick_first(run, grasp, pick)
            _pick_second(run, grasp, obstacles, rng)
            _hold(run)
    except _Ended as end:
        reason = str(end)
    lifted = next((s for s in run.snapshots if s[0] == "lift second"), None)
    rises = [] if lifted is None else [lifted[2 + i][2] - run.rest[i][2, 3] for i in (0, 1)]
    return {
        "trial": inputs.trial,
        "source": inputs.source,
        "object0": inputs.objects[0].name,
        "object1": inputs.objects[1].name,
        "merged_id": -1 if grasp is None else grasp.merged_id,
        "seed": inputs.seed,
        "offset0": offsets[0],
        "offset1": offsets[1],
        "phase": run.phase,
        "success": reason == "",
        "success_10cm": bool(rises) and min(rises) > RELEASED_HEIGHT,
        "reason": reason,
        "height0": float(run.heights[0]),
        "height1": float(run.heights[1]),
        "push1": run.push1,
        "planning_attempts": attempts,
        "steps": run.steps,
        "snapshot_phases": [snapshot[0] for snapshot in run.snapshots],
        "snapshot_robot_q": [snapshot[1] for snapshot in run.snapshots],
        "snapshot_pose0": [snapshot[2] for snapshot in run.snapshots],
        "snapshot_pose1": [snapshot[3] for snapshot in run.snapshots],
    }


def trial_inputs(
    source: str,
    objects: tuple[PreparedObject, PreparedObject],
    grasps: Sequence[TwoObjectGrasp],
    settings: EvaluateParameters,
    physics: PhysicsParameters,
    run_seed: int,
) -> list[TrialInput]:
    """Return the inputs of all trials of one pair; each trial's seed depends on the pair and its number alone."""
    identity = ("evaluate", source, objects[0].name, objects[1].name)
    orders = grasp_orders(len(grasps), settings.trials, settings.planning_attempts, item_generator(run_seed, *identity))
    return [
        TrialInput(
            trial=trial,
            source=source,
            objects=objects,
            grasps=tuple(grasps[index] for index in order),
            settings=settings,
            physics=physics,
            seed=item_seed(run_seed, *identity, trial),
        )
        for trial, order in enumerate(orders)
    ]
