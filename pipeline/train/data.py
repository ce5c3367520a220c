"""Examples to learn from: accepted rows of merged tables as arrays, and which of them are kept from training."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.model.clouds import Clouds, prepare_cloud, stack
from pipeline.model.completion import belief_of
from pipeline.model.held_out import STYLES, unseen_rows
from pipeline.model.representation import GraspBatch, grasps_of
from pipeline.records.errors import UserError
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.train import EncoderParameters, TrainDataParameters
from pipeline.stages.seeds import item_generator


@dataclass(frozen=True)
class Examples:
    """Accepted two-object grasps of all pairs, and the clouds of all objects."""

    objects: tuple[str, ...]
    pairs: tuple[tuple[str, str], ...]
    grasps: GraspBatch  # of N examples
    pair: NDArray[np.int64]  # (N,) index into pairs
    split: NDArray[np.str_]  # (N,) "training", "held_out" (a single grasp is unseen), "held_out_pair" (the pair is)
    held_out: dict[str, list[int]]  # "pinch.cube" -> single grasps that are kept from training, by id
    clouds: Clouds  # object by object, draw by draw
    frames: NDArray[np.float64] | None = None  # (C, 4, 4) pose of each cloud's frame in its object's; None: the same

    def pair_objects(self) -> NDArray[np.int64]:
        """Indices (P, 2) into ``objects``."""
        return np.array([[self.objects.index(name) for name in pair] for pair in self.pairs])


def held_out_objects(names: Iterable[str], data: TrainDataParameters, seed: int) -> set[str]:
    """Return which objects are kept from training; whether one is does not depend on the others."""

    def drawn(name: str) -> bool:
        mesh = re.sub(r"_pose\d+$", "", name)
        return item_generator(seed, "train", "held_out_object", mesh).random() < data.held_out_share

    return {
        name
        for name in names
        if name in data.held_out_objects
        or any(name.startswith(f"{source}_") for source in data.held_out_sources)
        or drawn(name)
    }


def held_out_grasps(table: pd.DataFrame, slot: int, share: float, seed: int) -> set[int]:
    """Return the single grasps of one object in one slot, by id, that are kept from training: a share, at least one.

    The choice depends on the seed, the object and the slot, so it is the same in all tables of the object.
    """
    ids = sorted({int(value) for value in table[f"grasp{slot}_id"]})
    if share == 0 or len(ids) < 2:
        return set()
    rng = item_generator(seed, "train", "held_out", str(table[f"object{slot}"].iloc[0]), slot)
    return set(rng.permutation(ids)[: max(1, round(share * len(ids)))].tolist())


def gather_examples(
    tables: Mapping[tuple[str, str], pd.DataFrame],
    objects: Mapping[str, PreparedObject],
    data: TrainDataParameters,
    encoder: EncoderParameters,
    seed: int,
) -> Examples:
    """Return the accepted rows of merged tables, by pair, with their split and the clouds of their objects.

    Raises:
        UserError: there is nothing to learn from, or ``held_out_pairs`` names an unknown pair.
    """
    for first, second in data.held_out_pairs:
        if (first, second) not in tables and not held_out_objects((first, second), data, seed):
            raise UserError(
                f"params.yaml: train.data.held_out_pairs names the unknown pair [{first}, {second}]; "
                "name a pair of `styles` and `pairs`."
            )
    accepted = {pair: table[table["rejected_by"] == ""] for pair, table in tables.items()}
    pairs = tuple(pair for pair, rows in accepted.items() if len(rows))
    if not pairs:
        raise UserError("data/merge holds no accepted grasp; loosen `merge` in params.yaml or synthesize more chains.")
    rows = pd.concat([accepted[pair] for pair in pairs], ignore_index=True)
    held_out = {
        f"{style}.{name}": sorted(held_out_grasps(own, slot, data.held_out, seed))
        for slot, style in enumerate(STYLES)
        for name, own in rows.groupby(f"object{slot}")
    }
    unseen = unseen_rows(rows, held_out)
    pair = np.concatenate([np.full(len(accepted[name]), index) for index, name in enumerate(pairs)])
    unseen_pair = np.isin(pair, [index for index, name in enumerate(pairs) if list(name) in data.held_out_pairs])
    split = np.where(unseen_pair, "held_out_pair", np.where(unseen, "held_out", "training"))
    if not (split == "training").any():
        raise UserError("params.yaml: train.data keeps every grasp from training; lower held_out or held_out_pairs.")
    names = tuple(dict.fromkeys(name for name_pair in pairs for name in name_pair))
    seen = [objects[name] for name in names]
    clouds, frames = (
        object_views(seen, encoder, seed) if data.view == "single" else (object_clouds(seen, encoder, seed), None)
    )
    return Examples(names, pairs, grasps_of(rows), pair, split, held_out, clouds, frames)


def object_clouds(objects: Sequence[PreparedObject], settings: EncoderParameters, seed: int) -> Clouds:
    """Return ``settings.clouds`` draws of every object's surface points, one object after the other."""
    return stack(
        [
            prepare_cloud(item.surface_points, settings, item_generator(seed, "train", "cloud", item.name, index))
            for item in objects
            for index in range(settings.clouds)
        ]
    )


def object_views(
    objects: Sequence[PreparedObject], settings: EncoderParameters, seed: int
) -> tuple[Clouds, NDArray[np.float64]]:
    """Return ``settings.clouds`` views of every object, one object after the other, and their frames (C, 4, 4).

    Every view is of another camera. The frame of a view is that of :mod:`pipeline.model.completion`.

    Raises:
        UserError: an object cannot be seen whole by one camera.
    """
    clouds, frames = [], []
    for item in objects:
        for index in range(settings.clouds):
            rng = item_generator(seed, "train", "view", item.name, index)
            belief = belief_of(item, rng)
            clouds.append(prepare_cloud(belief.points, settings, rng))
            frames.append(belief.T_object_belief)
    return stack(clouds), np.stack(frames)
