"""One trial: pick the first object with the pinching fingers, keep it, pick the second with ring finger and palm.

The result depends on the inputs alone: every trial has its own physics scene and its own random generator.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.compute.shared import Shared
from pipeline.evaluate.execution import Ended, Run
from pipeline.evaluate.grasps import SequenceGrasp, TwoObjectGrasp, grasp_orders
from pipeline.evaluate.moves import Pick, plan_pick
from pipeline.evaluate.scene import build_scene, object_obstacle, placed, placement_offsets
from pipeline.evaluate.sequence import ORDINALS, Posture, Surroundings, pick_phases, pick_task, plan_all, rest_phase
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.stages.seeds import item_generator, item_seed

if TYPE_CHECKING:
    from pipeline.motion.collisions import Obstacle


@dataclass(frozen=True)
class TrialInput:
    """All that a trial depends on."""

    trial: int
    source: str
    objects: tuple[PreparedObject, ...]  # two; none where they are sent apart, see run_trial_with
    grasps: tuple[TwoObjectGrasp, ...]  # in the order in which they are tried
    settings: EvaluateParameters
    physics: PhysicsParameters
    seed: int


def _choose(
    grasps: Sequence[SequenceGrasp], run: Run, around: Surroundings, rng: np.random.Generator
) -> tuple[SequenceGrasp | None, Pick | None, int, str]:
    """Return the first grasp for which all picks can be planned, its first pick, the attempts made, and a reason.

    The reason is ``no grasp`` when there is none, else the latest pick that could not be planned for any of them.

    Planning alone decides, before anything has moved; no grasp is tried in physics here. Later picks are planned as if
    those before went perfectly, and again later from what is measured.
    """
    furthest = 0
    for attempt, grasp in enumerate(grasps, start=1):
        picks = plan_all(grasp, around, run.posture, run.settings, rng)
        if len(picks) == len(grasp.picks):
            return grasp, picks[0], attempt, ""
        furthest = max(furthest, len(picks))
    return None, None, len(grasps), f"plan {ORDINALS[furthest]}" if grasps else "no grasp"


def _try(run: Run, grasp: SequenceGrasp, pick: Pick | None, around: Surroundings, rng: np.random.Generator) -> None:
    """Pick the first object, then plan and pick every further one from what is measured."""
    settings = run.settings
    for number in range(len(grasp.picks)):
        if number:
            measured = Posture(run.posture.arm, run.scene.robot.q[7:])
            now = around.moved(number, run.pose(number))
            pick = plan_pick(pick_task(number, grasp, now, measured, run.held_poses, settings), settings, rng)
        if pick is None:
            raise Ended(f"plan {ORDINALS[number]}")
        run.execute(pick_phases(number, run.posture, grasp, pick, settings))


def carry_out(
    run: Run,
    objects: Sequence[PreparedObject],
    grasps: Sequence[SequenceGrasp],
    rng: np.random.Generator,
    others: Sequence[Obstacle] = (),
) -> tuple[SequenceGrasp | None, int, str]:
    """Let the objects settle, choose a grasp and carry it out.

    Args:
        run: objects where they were put, nothing has moved yet.
        grasps: in the order in which they are tried.
        others: obstacles besides table, sponge and objects.

    Returns:
        The grasp (None when none could be planned), planning attempts, and why it ended early, '' on success.
    """
    grasp, attempts = None, 0
    try:
        run.settle(rest_phase("settle", run.posture, run.settings.settle_seconds, run.settings))
        obstacles = [object_obstacle(item, f"object{index}").at(run.pose(index)) for index, item in enumerate(objects)]
        around = Surroundings(tuple(obstacles), tuple(others))
        grasp, pick, attempts, reason = _choose(grasps, run, around, rng)
        if grasp is not None:
            _try(run, grasp, pick, around, rng)
    except Ended as end:
        reason = str(end)
    return grasp, attempts, reason


def run_trial(inputs: TrialInput, watch: Callable[[Run], None] | None = None) -> dict[str, Any]:
    """Run one trial and return its row of ``records.tables.TRIALS``.

    Phases: settle; open, approach, enter, close, lift the first object; the same for the second; hold. A reason ends
    the trial: ``no grasp`` (the pair has no merged grasp), ``plan first``, ``plan second``, ``collision on approach``,
    ``first slip``, ``first lost in transit``, ``second slip``, ``dropped in hold``, ``simulation diverged``.

    Args:
        watch: is shown the run after every control period.
    """
    rng = np.random.Generator(np.random.PCG64(inputs.seed))
    offsets = placement_offsets(inputs.settings, rng)
    scene = build_scene(
        inputs.objects, inputs.settings, inputs.physics, placed(inputs.objects, inputs.settings, offsets)
    )
    run = Run(scene, inputs.settings, rest=[body.pose for body in scene.objects], watch=watch)
    grasp, attempts, reason = carry_out(run, inputs.objects, inputs.grasps, rng)
    return {
        "trial": inputs.trial,
        "source": inputs.source,
        "object0": inputs.objects[0].name,
        "object1": inputs.objects[1].name,
        "merged_id": -1 if grasp is None else grasp.merged_id,
        "seed": inputs.seed,
        "offset0": offsets[0],
        "offset1": offsets[1],
        "planning_attempts": attempts,
        **run.outcome(reason),
    }


def run_trial_with(shared: Shared[tuple[PreparedObject, ...]], inputs: TrialInput) -> dict[str, Any]:
    """Run a trial whose ``objects`` are shared by all trials of its pair."""
    return run_trial(replace(inputs, objects=shared.value))


def trial_inputs(
    source: str,
    objects: tuple[PreparedObject, PreparedObject],
    grasps: Sequence[TwoObjectGrasp],
    settings: EvaluateParameters,
    physics: PhysicsParameters,
    run_seed: int,
) -> list[TrialInput]:
    """Return the inputs of all trials of one pair; each trial's seed depends on the pair and its number alone.

    Args:
        grasps: the preferred first; when there are more than trials, the first ones are tried.
    """
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
