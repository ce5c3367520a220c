"""One trial: pick the first object with the pinching fingers, keep it, pick the second with ring finger and palm.

The result depends on the inputs alone: every trial has its own physics scene and its own random generator.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.evaluate.execution import Ended, Run
from pipeline.evaluate.grasps import TwoObjectGrasp, grasp_orders
from pipeline.evaluate.moves import Pick, plan_pick
from pipeline.evaluate.scene import build_scene, object_obstacle, placed, placement_offsets
from pipeline.evaluate.sequence import (
    Posture,
    Surroundings,
    first_phases,
    plan_both,
    rest_phase,
    second_phases,
    second_task,
)
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.seeds import item_generator, item_seed


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


def _choose(
    inputs: TrialInput, run: Run, around: Surroundings, rng: np.random.Generator
) -> tuple[TwoObjectGrasp | None, Pick | None, int, str]:
    """Return the first grasp for which both picks can be planned, its first pick, the attempts made, and a reason.

    The reason is ``no grasp`` when the pair has none, else the pick that could not be planned for any of them.

    Planning alone decides, before anything has moved; no grasp is tried in physics here. The second pick is planned
    as if the first went perfectly, and again later from what is measured.
    """
    reason = "plan first" if inputs.grasps else "no grasp"
    for attempt, grasp in enumerate(inputs.grasps, start=1):
        first, second = plan_both(grasp, around, run.posture.arm, inputs.settings, rng)
        if first is not None and second is not None:
            return grasp, first, attempt, ""
        if first is not None:
            reason = "plan second"
    return None, None, len(inputs.grasps), reason


def _try(run: Run, grasp: TwoObjectGrasp, pick: Pick, around: Surroundings, rng: np.random.Generator) -> None:
    """Pick the first object, plan the second pick from what is measured, and pick the second object."""
    settings = run.settings
    run.execute(first_phases(run.posture, grasp, pick, settings))
    measured = Posture(run.posture.arm, run.scene.robot.q[7:])
    now = replace(around, second=around.second.at(run.pose(1)))
    second = plan_pick(second_task(grasp, now, measured, run.held_pose, settings), settings, rng)
    if second is None:
        raise Ended("plan second")
    run.execute(second_phases(run.posture, grasp, second, settings))


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
    obstacles = [object_obstacle(prepared, f"object{index}") for index, prepared in enumerate(inputs.objects)]
    grasp, attempts = None, 0
    try:
        run.settle(rest_phase("settle", run.posture, inputs.settings.settle_seconds, inputs.settings))
        around = Surroundings(obstacles[0].at(run.pose(0)), obstacles[1].at(run.pose(1)))
        grasp, pick, attempts, reason = _choose(inputs, run, around, rng)
        if grasp is not None and pick is not None:
            _try(run, grasp, pick, around, rng)
    except Ended as end:
        reason = str(end)
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
