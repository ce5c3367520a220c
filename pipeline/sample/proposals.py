"""From samples to grasps that a robot can try: refined, ranked, checked like any merged grasp."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.compute.fan_out import Workers
from pipeline.compute.pool import Calls, Work, run_one
from pipeline.compute.shared import Shared
from pipeline.hand.model import Hand
from pipeline.model.checkpoint import Checkpoint
from pipeline.model.network import GraspModel
from pipeline.pairing.combination import Pair, try_combination
from pipeline.pairing.readiness import ready_first, settling_physics
from pipeline.records.parameters.synthesize import EnergyParameters, StyleParameters
from pipeline.records.parameters.train import SamplingParameters
from pipeline.records.poses import pose_matrix
from pipeline.records.tables import MERGED
from pipeline.sample.execution import single_grasps
from pipeline.sample.quality import penetration_depth
from pipeline.sample.refinement import PairEnergy, Scored, refine
from pipeline.sample.sampling import sample_grasps

CHUNK = 16  # most samples tried at once; not the number of workers, on which results must not depend
SPARE = 4  # samples tried at once beyond those still wanted


@dataclass(frozen=True)
class Task:
    """Everything that proposals for one pair depend on, besides the model."""

    pair: Pair
    hand: Hand
    points: tuple[NDArray[np.float64], NDArray[np.float64]]  # what the model sees of the objects, object frames, m
    settings: SamplingParameters
    energy: EnergyParameters
    styles: tuple[StyleParameters, StyleParameters]  # of object 0 and of object 1
    seed: int


@dataclass(frozen=True)
class Drawn:
    """Samples of one pair before they are checked, best first."""

    raw: Scored  # as they came from the model
    ranked: Scored
    joint_violation: NDArray[np.float64]  # (B,) largest per sample, rad, before joints were clamped; of ``raw``


def pair_energy(task: Task) -> PairEnergy:
    """Return the energy of the task's pair."""
    objects = task.pair.object0, task.pair.object1
    return PairEnergy(objects, task.energy, task.styles, task.pair.merge.clearance, task.hand)


def draw_grasps(checkpoint: Checkpoint, model: GraspModel, task: Task, energy: PairEnergy) -> Drawn:
    """Sample, refine and rank grasps of one pair."""
    settings = task.settings
    grasps, violation = sample_grasps(
        checkpoint, model, task.hand, task.points, settings.draws, settings.sampler, settings.steps, task.seed
    )
    rng = np.random.default_rng(task.seed)
    raw = refine(energy, grasps, 0, settings.refine_step, rng)
    scored = refine(energy, grasps, settings.refine_iterations, settings.refine_step, rng)
    ranked = scored.chosen(np.argsort(scored.energy, kind="stable")) if settings.rank else scored
    return Drawn(raw, ranked, violation.max(1))


def check_grasps(task: Task, drawn: Drawn, workers: Workers) -> pd.DataFrame:
    """Return the table ``MERGED`` of one pair: samples in their order until enough are accepted, each with its outcome.

    ``grasp0_id`` and ``grasp1_id`` are the place of the sample in that order, and so is ``merged_id``.
    """
    return run_one(checking(task, drawn), workers, f"{task.pair.object0.name}--{task.pair.object1.name}")


def checking(task: Task, drawn: Drawn) -> Work[pd.DataFrame]:
    """Compute what :func:`check_grasps` returns, some samples at once."""
    settings = task.settings
    pair = checked_pair(task.pair, settings)
    rows: list[dict[str, Any]] = []
    accepted = 0
    with Shared((pair, task.hand, drawn.ranked)) as shared:
        while accepted < settings.grasps and len(rows) < settings.draws:
            count = min(CHUNK, settings.grasps - accepted + SPARE, settings.draws - len(rows))
            done = accepted / settings.grasps
            indices = range(len(rows), len(rows) + count)
            for row in (yield Calls(partial(_check, shared), indices, done, min(1.0, done + count / settings.grasps))):
                if accepted < settings.grasps:
                    rows.append(row | {"merged_id": len(rows)})
                    accepted += row["rejected_by"] == ""
    return pd.DataFrame(rows, columns=MERGED.names, dtype=object)


class Model:
    """A checkpoint and its network, made when it is first needed where it is used."""

    def __init__(self, checkpoint: Checkpoint) -> None:
        self.checkpoint = checkpoint

    @cached_property
    def network(self) -> GraspModel:
        """The network, ready to predict."""
        return self.checkpoint.model()


def sampling(model: Shared[Model], task: Task) -> Work[tuple[pd.DataFrame, Drawn, dict[str, Any]]]:
    """Return the table of checked grasps of a pair, what was drawn, and figures on both."""
    with Shared(task) as shared:
        ((drawn, raw),) = yield Calls(partial(_draw, model, shared), [None], 0.0, 0.1)
        table = yield from checking(task, drawn)
        accepted = table.loc[table["rejected_by"] == "", "merged_id"].to_numpy(dtype="int64")
        (ranked,) = yield Calls(partial(_quality, shared), [drawn.ranked.chosen(accepted)], 0.9)
    figures = {
        "drawn": len(drawn.ranked.grasps),
        "joint_violation_mean": float(drawn.joint_violation.mean()),
        "raw": raw,
        "ranked": ranked,
    }
    return table, drawn, figures


def _draw(model: Shared[Model], shared: Shared[Task], _: None) -> tuple[Drawn, dict[str, float]]:
    """Return what the model draws for a pair, and figures of it as it came from the model."""
    energy = pair_energy(shared.value)
    drawn = draw_grasps(model.value.checkpoint, model.value.network, shared.value, energy)
    return drawn, quality(energy, drawn.raw)


def _quality(shared: Shared[Task], scored: Scored) -> dict[str, float]:
    return quality(pair_energy(shared.value), scored)


def checked_pair(pair: Pair, settings: SamplingParameters) -> Pair:
    """Return the pair with the limits of ``merge``, or ones that nothing exceeds where checks are switched off."""
    changes: dict[str, Any] = {"physics_test": settings.physics and pair.merge.physics_test}
    if not settings.check:
        changes |= {"clearance": -1.0, "penetration_tolerance": 1.0, "mount_clearance": -1.0}
    return replace(pair, merge=pair.merge.model_copy(update=changes))


def _check(shared: Shared[tuple[Pair, Hand, Scored]], index: int) -> dict[str, Any]:
    return check_sample(*shared.value, index)


def check_sample(pair: Pair, hand: Hand, scored: Scored, index: int) -> dict[str, Any]:
    """Return the row of one sample, all columns of ``MERGED`` but ``merged_id``; ``pair`` of :func:`checked_pair`."""
    objects, grasps = (pair.object0, pair.object1), scored.grasps
    first, second = single_grasps(
        hand, objects, grasps.T_hand_object[index], grasps.q[index], scored.contacts, index, pair.validate
    )
    ready = ready_first(pair.object0, settling_physics(pair.merge, pair.physics, pair.validate), first)
    return try_combination(pair, ready, second)


def quality(energy: PairEnergy, scored: Scored) -> dict[str, float]:
    """Return figures of samples without physics, mm: overlap of hand and objects, distance of contacts.

    Medians over samples; of the overlap of the objects the largest.
    """
    hand, grasps = energy.hand, scored.grasps
    depths = [
        penetration_depth(hand, item, energy.fields[slot], grasps.T_hand_object[:, slot], grasps.q)
        for slot, item in enumerate(energy.objects)
    ]
    contact = [own.distance for own in scored.contacts]
    return {
        "penetration_mm_median": 1000 * float(np.median(np.maximum(*depths))),
        "contact_distance_mm_median": 1000 * float(np.median(np.mean(contact, axis=0))),
        "object_overlap_mm_max": 1000 * float(scored.overlap.max()),
    }


def in_frames_of_files(table: pd.DataFrame, centre0: NDArray[np.float64], centre1: NDArray[np.float64]) -> pd.DataFrame:
    """Return a merged table with object frames whose origins lie at minus the centres (3,): the frames of files.

    A point p of the file is p - centre in the object's frame; the axes are the same.
    """
    moved = table.copy()
    for slot, centre in enumerate((centre0, centre1)):
        position, quaternion = (np.stack(table[f"{name}_hand_object{slot}"]) for name in ("position", "quaternion"))
        T = pose_matrix(position, quaternion)
        moved[f"position_hand_object{slot}"] = list(T[:, :3, 3] - T[:, :3, :3] @ centre)
    return moved
