"""From samples to grasps that a robot can try: refined, ranked, checked like any merged grasp."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.compute.pool import Calls, Work
from pipeline.compute.shared import Shared
from pipeline.hand.model import Hand
from pipeline.model.checkpoint import Checkpoint, read_checkpoint
from pipeline.model.held_out import STYLES
from pipeline.model.network import GraspModel
from pipeline.model.representation import dimensions
from pipeline.pairing.combination import check_combination
from pipeline.pairing.readiness import ready
from pipeline.pairing.task import Task, task_of
from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.synthesize import EnergyParameters, StyleParameters
from pipeline.records.parameters.train import SamplingParameters
from pipeline.records.tables import MERGED
from pipeline.robustness.measures import measuring
from pipeline.sample.execution import single_grasps
from pipeline.sample.quality import penetration_depth
from pipeline.sample.refinement import PairEnergy, Scored, refine
from pipeline.sample.sampling import sample_grasps

CHUNK = 16  # most samples tried at once; not the number of workers, on which results must not depend
SPARE = 4  # samples tried at once beyond those still wanted


@dataclass(frozen=True)
class SampleRequest:
    """Everything that proposals for one pair depend on, besides the model."""

    pair: Task  # two objects
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


def trained_for(hand: Hand) -> Checkpoint:
    """Return the trained model.

    Raises:
        UserError: there is none, it is damaged, or it was trained for another hand.
    """
    checkpoint = read_checkpoint(paths.MODEL_FOLDER)
    trained, wanted = len(checkpoint.normalisation.mean), dimensions(len(STYLES), hand)
    if checkpoint.hand != hand.name or trained != wanted:
        raise UserError(
            f"{paths.MODEL_FOLDER} knows grasps of {trained} numbers of the hand {checkpoint.hand}, those of the hand "
            f"{hand.name} have {wanted}; run `dvc repro train` to make it for this hand."
        )
    return checkpoint


def request_of(
    parameters: Mapping[str, Any],
    hand: Hand,
    objects: tuple[PreparedObject, PreparedObject],
    points: tuple[NDArray[np.float64], NDArray[np.float64]],
    seed: int,
) -> SampleRequest:
    """Return what is asked of the model for a pair.

    Args:
        parameters: sections of ``params.yaml``: seed, picks, train.sampling, synthesize.energy and both styles, merge,
            physics, validate and robustness.
        points: (n, 3) that the model sees of each object, object frames.
    """
    own = measuring(parameters["robustness"], parameters["seed"], *(item.name for item in objects))
    limits = (parameters["merge"], parameters["physics"], parameters["validate"])
    return SampleRequest(
        pair=task_of(hand, parameters["picks"], objects, *limits, own),
        points=points,
        settings=parameters["train.sampling"],
        energy=parameters["synthesize.energy"],
        styles=(parameters["synthesize.pinch"], parameters["synthesize.side"]),
        seed=seed,
    )


def pair_energy(request: SampleRequest) -> PairEnergy:
    """Return the energy of the request's pair."""
    first, second = request.pair.objects
    return PairEnergy((first, second), request.energy, request.styles, request.pair.merge.clearance, request.pair.hand)


def draw_grasps(checkpoint: Checkpoint, model: GraspModel, request: SampleRequest, energy: PairEnergy) -> Drawn:
    """Sample, refine and rank grasps of one pair."""
    settings = request.settings
    grasps, violation = sample_grasps(
        checkpoint,
        model,
        request.pair.hand,
        request.points,
        settings.draws,
        settings.sampler,
        settings.steps,
        request.seed,
    )
    rng = np.random.default_rng(request.seed)
    raw = refine(energy, grasps, 0, settings.refine_step, rng)
    scored = refine(energy, grasps, settings.refine_iterations, settings.refine_step, rng)
    ranked = scored.chosen(np.argsort(scored.energy, kind="stable")) if settings.rank else scored
    return Drawn(raw, ranked, violation.max(1))


def checking(request: SampleRequest, drawn: Drawn) -> Work[pd.DataFrame]:
    """Compute the table ``MERGED`` of one pair: samples in their order until enough are accepted.

    Both ``grasp_ids`` are the place of the sample in that order, and so is ``merged_id``.
    """
    settings = request.settings
    pair = checked_pair(request.pair, settings)
    rows: list[dict[str, Any]] = []
    accepted = 0
    with Shared((pair, drawn.ranked)) as shared:
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


def sampling(model: Shared[Model], request: SampleRequest) -> Work[tuple[pd.DataFrame, Drawn, dict[str, Any]]]:
    """Return the table of checked grasps of a pair, what was drawn, and figures on both."""
    with Shared(request) as shared:
        ((drawn, raw),) = yield Calls(partial(_draw, model, shared), [None], 0.0, 0.1)
        table = yield from checking(request, drawn)
        accepted = table.loc[table["rejected_by"] == "", "merged_id"].to_numpy(dtype="int64")
        ranked: dict[str, float] = {}  # where no sample is accepted
        if len(accepted):
            (ranked,) = yield Calls(partial(_quality, shared), [drawn.ranked.chosen(accepted)], 0.9)
    figures = {
        "drawn": len(drawn.ranked.grasps),
        "joint_violation_mean": float(drawn.joint_violation.mean()),
        "raw": raw,
        "ranked": ranked,
    }
    return table, drawn, figures


def _draw(model: Shared[Model], shared: Shared[SampleRequest], _: None) -> tuple[Drawn, dict[str, float]]:
    """Return what the model draws for a pair, and figures of it as it came from the model."""
    energy = pair_energy(shared.value)
    drawn = draw_grasps(model.value.checkpoint, model.value.network, shared.value, energy)
    return drawn, quality(energy, drawn.raw)


def _quality(shared: Shared[SampleRequest], scored: Scored) -> dict[str, float]:
    return quality(pair_energy(shared.value), scored)


def checked_pair(pair: Task, settings: SamplingParameters) -> Task:
    """Return the pair with the limits of ``merge``, or ones that nothing exceeds where checks are switched off."""
    changes: dict[str, Any] = {"physics_test": settings.physics and pair.merge.physics_test}
    if not settings.check:
        changes |= {"clearance": -1.0, "penetration_tolerance": 1.0, "mount_clearance": -1.0}
    return replace(pair, merge=pair.merge.model_copy(update=changes))


def _check(shared: Shared[tuple[Task, Scored]], index: int) -> dict[str, Any]:
    return check_sample(*shared.value, index)


def check_sample(pair: Task, scored: Scored, index: int) -> dict[str, Any]:
    """Return the row of one sample, all columns of ``MERGED`` but ``merged_id``; ``pair`` of :func:`checked_pair`."""
    first, second = pair.objects
    grasps = scored.grasps
    singles = single_grasps(
        pair.hand,
        (first, second),
        grasps.T_hand_object[index],
        grasps.q[index],
        scored.contacts,
        index,
        pair.validate,
    )
    return check_combination(pair, [ready(pair, number, single) for number, single in enumerate(singles)])


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
