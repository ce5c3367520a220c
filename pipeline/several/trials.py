"""Robot trials of a sequence, as rows of ``records.tables.JOINED_TRIALS``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.evaluate.execution import Run
from pipeline.evaluate.grasps import PickGrasp, SeveralObjectsGrasp, grasp_orders
from pipeline.evaluate.moves import SPONGE_DROP
from pipeline.evaluate.scene import Post, build_scene, post_obstacle, without_grid
from pipeline.evaluate.trial import carry_out
from pipeline.pairing.grasps import fingers_of
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.several import PickParameters, SeveralParameters
from pipeline.records.poses import pose_matrix
from pipeline.stages.seeds import item_generator, item_seed


@dataclass(frozen=True)
class TrialInput:
    """All that a trial depends on."""

    trial: int
    seed: int
    objects: tuple[PreparedObject, ...]
    picks: tuple[PickParameters, ...]
    grasps: tuple[SeveralObjectsGrasp, ...]  # in the order in which they are tried
    settings: EvaluateParameters
    physics: PhysicsParameters


def grasp_from_row(row: dict[str, Any], sequence: SeveralParameters) -> SeveralObjectsGrasp:
    """Return the grasp in an accepted row of ``JOINED``."""
    lengths = [None, *(float(length) for length in row["approach_lengths"])]
    return SeveralObjectsGrasp(
        merged_id=int(row["merged_id"]),
        q=np.asarray(row["q"], np.float64),
        squeeze_q=np.asarray(row["squeeze_q"], np.float64),
        picks=tuple(
            PickGrasp(
                fingers=fingers_of([pick.fingers]),
                open_q=np.asarray(row["open_q"][number], np.float64),
                T_hand_object=pose_matrix(row["positions_hand_object"][number], row["quaternions_hand_object"][number]),
                approach_direction=np.asarray(row["approach_directions"][number], np.float64),
                approach_length=lengths[number],
            )
            for number, pick in enumerate(sequence.picks)
        ),
    )


def posts_of(picks: tuple[PickParameters, ...]) -> list[Post]:
    """Return the posts of all objects that stand on one."""
    return [Post(*pick.place, pick.post.width, pick.post.height) for pick in picks if pick.post is not None]


def standing_pose(
    pick: PickParameters, prepared: PreparedObject, settings: EvaluateParameters, offset: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return ``T_world_object`` (4, 4) with the object ``offset`` (3,), x, y (m) and yaw (rad), beside its place."""
    height = settings.sponge_height + (0.0 if pick.post is None else pick.post.height) - prepared.bottom
    half = offset[2] / 2
    position = [pick.place[0] + offset[0], pick.place[1] + offset[1], height]
    return pose_matrix(position, [np.cos(half), 0.0, 0.0, np.sin(half)])


def run_trial(inputs: TrialInput) -> dict[str, Any]:
    """Run one trial and return its row; phases and reasons are those of ``pipeline.evaluate.trial.run_trial``."""
    rng = np.random.Generator(np.random.PCG64(inputs.seed))
    settings = inputs.settings
    limits = np.array([settings.perturbation, settings.perturbation, settings.yaw_perturbation])
    offsets = rng.uniform(-1.0, 1.0, (len(inputs.objects), 3)) * limits
    places = zip(inputs.picks, inputs.objects, offsets, strict=True)
    poses = [standing_pose(pick, prepared, settings, offset) for pick, prepared, offset in places]
    posts = posts_of(inputs.picks)
    scene = build_scene(inputs.objects, settings, inputs.physics, poses, posts=posts)
    run = Run(scene, settings, rest=[body.pose for body in scene.objects])
    obstacles = [post_obstacle(post, settings, SPONGE_DROP) for post in posts]
    grasp, attempts, reason = carry_out(run, inputs.objects, inputs.grasps, rng, obstacles)
    outcome = run.outcome(reason)
    objects = range(len(inputs.objects))
    kept = ("phase", "success", "success_10cm", "reason", "steps", "snapshot_phases", "snapshot_robot_q")
    return {
        "trial": inputs.trial,
        "objects": [prepared.name for prepared in inputs.objects],
        "merged_id": -1 if grasp is None else grasp.merged_id,
        "seed": inputs.seed,
        "offsets": list(offsets),
        "heights": [outcome[f"height{index}"] for index in objects],
        "planning_attempts": attempts,
        **{name: outcome[name] for name in kept},
        "snapshot_poses": [outcome[f"snapshot_pose{index}"] for index in objects],
    }


def trial_inputs(
    table: pd.DataFrame,
    objects: tuple[PreparedObject, ...],
    sequence: SeveralParameters,
    settings: EvaluateParameters,
    physics: PhysicsParameters,
) -> list[TrialInput]:
    """Return the inputs of all trials with the accepted grasps of a table ``JOINED``."""
    accepted = table[table["rejected_by"] == ""].to_dict("records")
    grasps = [grasp_from_row({str(name): value for name, value in row.items()}, sequence) for row in accepted]
    identity = ("several", *(prepared.name for prepared in objects))
    rng = item_generator(sequence.seed, *identity)
    orders = grasp_orders(len(grasps), sequence.trials, settings.planning_attempts, rng)
    return [
        TrialInput(
            trial=trial,
            seed=item_seed(sequence.seed, *identity, trial),
            objects=tuple(without_grid(prepared) for prepared in objects),
            picks=tuple(sequence.picks),
            grasps=tuple(grasps[index] for index in order),
            settings=settings,
            physics=physics,
        )
        for trial, order in enumerate(orders)
    ]
