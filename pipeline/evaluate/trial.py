"""One trial: pick the first object, keep it, pick the next with other fingers, until all are in the hand.

The result depends on the inputs alone: every trial has its own physics scene and its own random generator.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pipeline.compute.shared import Shared
from pipeline.evaluate.disturbance import TrialDisturbance, draw, undrawn
from pipeline.evaluate.execution import Ended, Run
from pipeline.evaluate.grasps import SequenceGrasp, grasp_orders
from pipeline.evaluate.moves import SPONGE_DROP, Pick, plan_pick
from pipeline.evaluate.scene import build_scene, object_obstacle, placed, placement_offsets, post_obstacle, posts_of
from pipeline.evaluate.sequence import Surroundings, pick_phases, pick_task, plan_all, rest_phase
from pipeline.hand.model import Hand
from pipeline.hand.robot import robot_joint_names
from pipeline.records.objects import PreparedObject
from pipeline.records.ordinals import ORDINALS
from pipeline.records.parameters.conditions import DistributionParameters
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.picks import PickParameters
from pipeline.records.trial_reasons import TrialReason
from pipeline.stages.seeds import item_generator, item_seed

if TYPE_CHECKING:
    from pipeline.motion.collisions import Obstacle


@dataclass(frozen=True)
class TrialInput:
    """All that a trial depends on."""

    trial: int
    source: str
    hand: Hand
    picks: tuple[PickParameters, ...]
    objects: tuple[PreparedObject, ...]  # none where they are sent apart, see run_trial_with
    grasps: tuple[SequenceGrasp, ...]  # in the order in which they are tried
    settings: EvaluateParameters
    physics: PhysicsParameters
    seed: int
    distribution: DistributionParameters | None = None  # from which the trial draws, if anything


def _choose(
    grasps: Sequence[SequenceGrasp], run: Run, around: Surroundings, rng: np.random.Generator
) -> tuple[SequenceGrasp | None, Pick | None, int, TrialReason | None]:
    """Return the first grasp for which all picks can be planned, its first pick, the attempts made, and a reason.

    The reason, without such a grasp, is ``no grasp`` when there is none at all, else the latest pick that could not be
    planned for any of them.

    Planning alone decides, before anything has moved; no grasp is tried in physics here. Later picks are planned as if
    those before went perfectly, and again later from what is measured.
    """
    furthest = 0
    for attempt, grasp in enumerate(grasps, start=1):
        picks = plan_all(grasp, run.scene.hand, around, run.posture, run.settings, rng)
        if len(picks) == len(grasp.picks):
            return grasp, picks[0], attempt, None
        furthest = max(furthest, len(picks))
    reason = TrialReason[f"plan_{ORDINALS[furthest]}".upper()] if grasps else TrialReason.NO_GRASP
    return None, None, len(grasps), reason


def _try(
    run: Run,
    objects: Sequence[PreparedObject],
    grasp: SequenceGrasp,
    pick: Pick | None,
    around: Surroundings,
    rng: np.random.Generator,
) -> None:
    """Pick the first object, then plan and pick every further one from what is measured."""
    settings = run.settings
    for number in range(len(grasp.picks)):
        if number:
            now = around.moved(number, run.believed_pose(number, objects[number].vertices))
            held = [run.believed_in_hand(index) for index in range(number)]
            task = pick_task(number, grasp, run.scene.hand, now, run.measured_posture(), held, settings)
            pick = plan_pick(task, settings, rng)
        if pick is None:
            raise Ended(TrialReason[f"plan_{ORDINALS[number]}".upper()])
        run.execute(pick_phases(number, run.posture, grasp, pick, settings))


def carry_out(
    run: Run,
    objects: Sequence[PreparedObject],
    grasps: Sequence[SequenceGrasp],
    rng: np.random.Generator,
    others: Sequence[Obstacle] = (),
) -> tuple[SequenceGrasp | None, int, TrialReason | None]:
    """Let the objects settle, choose a grasp and carry it out.

    Args:
        run: objects where they were put, nothing has moved yet.
        grasps: in the order in which they are tried.
        others: obstacles besides table, sponge and objects.

    Returns:
        The grasp (None when none could be planned), planning attempts, and why it ended early, None on success.
    """
    grasp, attempts = None, 0
    try:
        run.settle(rest_phase("settle", run.posture, run.settings.settle_seconds, run.settings))
        obstacles = [
            object_obstacle(item, f"object{index}").at(run.believed_pose(index, item.vertices))
            for index, item in enumerate(objects)
        ]
        around = Surroundings(tuple(obstacles), tuple(others))
        grasp, pick, attempts, reason = _choose(grasps, run, around, rng)
        if grasp is not None:
            _try(run, objects, grasp, pick, around, rng)
    except Ended as end:
        reason = end.reason
    return grasp, attempts, reason


def disturbance_of(inputs: TrialInput) -> TrialDisturbance | None:
    """Return what a trial draws besides the placement of its objects."""
    if inputs.distribution is None:
        return None
    return draw(inputs.distribution, inputs.seed, len(inputs.picks), len(robot_joint_names(inputs.hand)))


def run_trial(inputs: TrialInput, watch: Callable[[Run], None] | None = None) -> dict[str, Any]:
    """Run one trial and return its row of ``records.tables.TRIALS``.

    Phases: settle; open, approach, enter, close, lift the first object; the same for every further one; hold. A member
    of ``TrialReason`` ends the trial.

    Args:
        watch: is shown the run after every control period.
    """
    rng = np.random.Generator(np.random.PCG64(inputs.seed))
    settings, picks = inputs.settings, inputs.picks
    offsets = placement_offsets(len(picks), settings, rng)
    poses, posts = placed(picks, inputs.objects, settings, offsets), posts_of(picks, settings)
    drawn = disturbance_of(inputs)
    scene = build_scene(inputs.hand, inputs.objects, settings, inputs.physics, poses, posts=posts, disturbance=drawn)
    run = Run(scene, settings, rest=[body.pose for body in scene.objects], watch=watch, disturbance=drawn)
    obstacles = [post_obstacle(post, settings, SPONGE_DROP) for post in posts]
    grasp, attempts, reason = carry_out(run, inputs.objects, inputs.grasps, rng, obstacles)
    return {
        "trial": inputs.trial,
        "source": inputs.source,
        "objects": [prepared.name for prepared in inputs.objects],
        "merged_id": -1 if grasp is None else grasp.merged_id,
        "seed": inputs.seed,
        "offsets": list(offsets),
        **(drawn.columns() if drawn else undrawn()),
        "planning_attempts": attempts,
        **run.outcome(reason),
    }


def run_trial_with(shared: Shared[tuple[PreparedObject, ...]], inputs: TrialInput) -> dict[str, Any]:
    """Run a trial whose ``objects`` are shared by all trials of its pair."""
    return run_trial(replace(inputs, objects=shared.value))


@dataclass(frozen=True)
class Draw:
    """What the random draws of a trial decide."""

    seed: int  # of the trial
    order: NDArray[np.int64]  # indices of the grasps, in the order in which they are tried


def draws(source: str, names: Sequence[str], count: int, settings: EvaluateParameters, run_seed: int) -> list[Draw]:
    """Return the draws of all trials with some objects; each trial's seed depends on them and its number alone.

    Args:
        names: of the objects, in the order of picking.
        count: how many grasps there are.
    """
    identity = ("evaluate", source, *names)
    orders = grasp_orders(count, settings.trials, settings.planning_attempts, item_generator(run_seed, *identity))
    return [Draw(item_seed(run_seed, *identity, trial), order) for trial, order in enumerate(orders)]


def trial_inputs(
    source: str,
    hand: Hand,
    picks: Sequence[PickParameters],
    objects: Sequence[PreparedObject],
    grasps: Sequence[SequenceGrasp],
    settings: EvaluateParameters,
    physics: PhysicsParameters,
    run_seed: int,
    distribution: DistributionParameters | None = None,
) -> list[TrialInput]:
    """Return the inputs of all trials with some objects.

    Args:
        grasps: the preferred first; when there are more than trials, the first ones are tried.
        distribution: from which every trial draws, if anything.
    """
    names = [prepared.name for prepared in objects]
    return [
        TrialInput(
            trial=trial,
            source=source,
            hand=hand,
            picks=tuple(picks),
            objects=tuple(objects),
            grasps=tuple(grasps[index] for index in drawn.order),
            settings=settings,
            physics=physics,
            seed=drawn.seed,
            distribution=distribution,
        )
        for trial, drawn in enumerate(draws(source, names, len(grasps), settings, run_seed))
    ]
