"""Grasps of a pair of objects of which nothing is stored: two ways to make them, and one order of all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.compute.fan_out import Workers
from pipeline.compute.pool import Work, run_one
from pipeline.evaluate.grasps import preference
from pipeline.hand.model import Hand
from pipeline.hand.support import support_of
from pipeline.merge.search import Inputs, merging
from pipeline.pairing.grasps import distinct_grasps, validated_grasps
from pipeline.pairing.task import groups_of, task_of
from pipeline.records.errors import UserError
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.picks import PickParameters, narrowed, waiting_fingers
from pipeline.records.paths import MODEL_FOLDER
from pipeline.records.poses import pose_matrix
from pipeline.robustness.measures import measuring
from pipeline.sample.proposals import checking, draw_grasps, pair_energy, request_of, trained_for
from pipeline.stages.seeds import item_generator
from pipeline.synthesize.candidates import Request, synthesis
from pipeline.validate.table import validation

Pair = tuple[PreparedObject, PreparedObject]
SYNTHESIS_DRAWS = 4  # combinations tried for each grasp wanted


def by_model(
    parameters: Mapping[str, Any], hand: Hand, objects: Pair, points: Sequence[NDArray[np.float64]], count: int
) -> Work[pd.DataFrame]:
    """Compute samples of the trained model, refined and checked: rows of ``MERGED``.

    Args:
        parameters: see :func:`pipeline.sample.proposals.request_of`.
        points: (n, 3) that the model sees of each object, object frames, m.
        count: accepted grasps wanted.

    Raises:
        UserError: there is no trained model, or it does not see whole objects.
    """
    checkpoint = trained_for(hand)
    if checkpoint.view != "whole":
        raise UserError(
            f"{MODEL_FOLDER} was trained on views of one camera, but a file does not say where its camera stood; train "
            "with train.data.view: whole, or use --method synthesize."
        )
    settings = parameters["train.sampling"]
    enough = settings.model_copy(update={"grasps": count, "draws": max(settings.draws, 2 * count)})
    seen = (points[0], points[1])
    request = request_of({**parameters, "train.sampling": enough}, hand, objects, seen, parameters["seed"])
    drawn = draw_grasps(checkpoint, checkpoint.model(), request, pair_energy(request))
    return (yield from checking(request, drawn))


def by_synthesis(
    parameters: Mapping[str, Any], hand: Hand, objects: Pair, count: int, chains: int, workers: Workers
) -> pd.DataFrame:
    """Return grasps synthesized for each object, tested in physics, and merged: rows of ``MERGED``.

    Args:
        parameters: sections of ``params.yaml``, those of :func:`by_model` and synthesize.optimizer.
        count: accepted grasps wanted.
        chains: of the first object; the second gets twice as many, as fewer of them survive.
    """
    picks, singles = parameters["picks"], []
    for number, (item, pick) in enumerate(zip(objects, picks, strict=True)):
        style = narrowed(parameters[f"synthesize.{pick.style}"], pick).model_copy(
            update={"chains": chains * (1 + number)}
        )
        request = Request(
            prepared=item,
            style=pick.style,
            run_seed=parameters["seed"],
            energy=parameters["synthesize.energy"],
            optimizer=parameters["synthesize.optimizer"],
            settings=style,
            waiting=waiting_fingers(picks, number),
            hand=hand,
        )
        candidates = run_one(synthesis(request), workers, f"synthesize {item.name}")
        tested = run_one(_validated(parameters, hand, item, pick, candidates), workers, f"validate {item.name}")
        singles.append(tested)
        print(f"{item.name}: {_outcomes(tested)}")
    groups = groups_of(hand, picks)
    merge = parameters["merge"].model_copy(
        update={"grasps_per_pair": count, "most_combinations": SYNTHESIS_DRAWS * count}
    )
    distinct = tuple(
        distinct_grasps(hand, validated_grasps(table), groups, number, merge.distinct_distance)
        for number, table in enumerate(singles)
    )
    names = [item.name for item in objects]
    limits = (merge, parameters["physics"], parameters["validate"])
    measured = measuring(parameters["robustness"], parameters["seed"], *names)
    inputs = Inputs(
        task_of(hand, picks, objects, *limits, measured), distinct, item_generator(parameters["seed"], "merge", *names)
    )
    found: dict[str, pd.DataFrame] = {}
    run_one(merging({"pair": inputs}, found.__setitem__), workers, "merge")
    return found["pair"]


def _outcomes(tested: pd.DataFrame) -> str:
    """Return how many single grasps hold, and what rejected most of the others."""
    reasons = tested["rejected_by"][tested["rejected_by"] != ""].str.split(",").str[0].value_counts()
    others = ", ".join(f"{count} by {reason}" for reason, count in reasons.head(3).items())
    held = int((tested["rejected_by"] == "").sum())
    return f"{held} of {len(tested)} grasps hold" + (f"; rejected: {others}" if others else "")


def _validated(
    parameters: Mapping[str, Any], hand: Hand, item: PreparedObject, pick: PickParameters, candidates: pd.DataFrame
) -> Work[pd.DataFrame]:
    measured = measuring(parameters["robustness"], parameters["seed"], item.name)
    return validation(candidates, item, parameters["physics"], parameters["validate"], support_of(pick), hand, measured)


def ranked(tables: Mapping[str, pd.DataFrame], least_room: float, count: int) -> pd.DataFrame:
    """Return the accepted rows of tables by method, with the column ``method``, in the order in which trials try them.

    Args:
        least_room: m, see :func:`pipeline.evaluate.grasps.preference`.
        count: how many are kept.
    """
    accepted = [table[table["rejected_by"] == ""].assign(method=method) for method, table in tables.items()]
    together = pd.concat(accepted, ignore_index=True)
    best = together.iloc[preference(together, least_room)[:count]].reset_index(drop=True)
    return best.assign(merged_id=range(len(best)))


def in_frames_of_files(table: pd.DataFrame, centres: Sequence[NDArray[np.float64]]) -> pd.DataFrame:
    """Return a merged table with object frames whose origins lie at minus the centres (3,): the frames of files.

    A point p of the file is p - centre in the object's frame; the axes are the same.
    """
    positions = np.array([np.stack(own) for own in table["positions_hand_object"]])
    quaternions = np.array([np.stack(own) for own in table["quaternions_hand_object"]])
    for number, centre in enumerate(centres):
        T = pose_matrix(positions[:, number], quaternions[:, number])
        positions[:, number] = T[:, :3, 3] - T[:, :3, :3] @ centre
    return table.assign(positions_hand_object=[list(own) for own in positions])
