"""How different the merged grasps of a data set are from each other."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.hand.model import Hand
from pipeline.hand.moves import finger_joints
from pipeline.hand.parts import part_points
from pipeline.records import paths
from pipeline.records.poses import pose_matrix, transform_points
from pipeline.records.tables import VALIDATED, read_table
from pipeline.report.counting import SYNTHESIZED, PairCounts, Single

SECTORS = 12  # of the compass, 30 degrees each


@dataclass(frozen=True)
class UsedGrasps:
    """The single grasps of one object that merged grasps are made of, in order of ``grasp_id``."""

    style: str
    object_name: str
    validated: int  # grasps that passed validation
    grasp_ids: NDArray[np.int64]  # (k,)
    distances: NDArray[np.float64]  # (k, k) m, mean over surface points of the part of the hand that counts
    sectors: NDArray[np.int64]  # (k,) of the compass, in which the hand is seen from the object
    approach_elevations: NDArray[np.float64]  # (k,) rad, over the horizontal, from where the hand comes
    contact_sets: int  # distinct sets of contact candidates
    fingers: dict[str, int]  # who touches -> grasps
    joint_spread: float  # rad, standard deviation over the grasps, mean over the joints of the part


@dataclass(frozen=True)
class PairDiversity:
    """How different the merged grasps of one pair are.

    The distance of two merged grasps is the larger one of the distances of their pinch and of their side grasps.
    """

    first: str
    second: str
    grasps: int
    pinch_grasps: int  # distinct ones
    side_grasps: int
    most_uses: int  # of the single grasp that is in most of them
    closest: float  # m, smallest distance of two merged grasps; nan with fewer than two
    typical: float  # m, median distance of two
    sectors0: int  # of the compass, in which the hand is seen from object 0
    sectors1: int


def used_grasps(hand: Hand, style: str, object_name: str, validated: pd.DataFrame, used: Iterable[int]) -> UsedGrasps:
    """Return what is known of the grasps ``used`` (by ``grasp_id``) of a validated table."""
    rows = validated[validated["grasp_id"].isin(set(used))].sort_values("grasp_id")
    q = np.array(rows["q"].tolist(), np.float64).reshape(-1, hand.joint_count)
    poses = [
        pose_matrix(position, quaternion)
        for position, quaternion in zip(rows["position_object_hand"], rows["quaternion_object_hand"], strict=True)
    ]
    shapes = [transform_points(T, part_points(style, joints, hand)) for T, joints in zip(poses, q, strict=True)]
    distances = np.array(
        [np.linalg.norm(np.stack(shapes) - shape, axis=2).mean(1) for shape in shapes], np.float64
    ).reshape(len(shapes), len(shapes))
    positions = np.array([T[:3, 3] for T in poses]).reshape(-1, 3)
    directions = np.array(rows["approach_direction"].tolist(), np.float64).reshape(-1, 3)
    joints = finger_joints(hand.style(style).fingers, hand)
    return UsedGrasps(
        style=style,
        object_name=object_name,
        validated=int((validated["rejected_by"] == "").sum()),
        grasp_ids=rows["grasp_id"].to_numpy(np.int64),
        distances=distances,
        sectors=compass_sectors(positions[:, 0], positions[:, 1]),
        approach_elevations=np.arcsin(np.clip(directions[:, 2], -1.0, 1.0)),
        contact_sets=len({frozenset(map(int, contacts)) for contacts in rows["contact_candidates"]}),
        fingers={str(name): int(count) for name, count in sorted(rows["fingers"].value_counts().items())},
        joint_spread=float(q[:, joints].std(axis=0).mean()) if len(q) else 0.0,
    )


def compass_sectors(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return for directions (k,) in the plane in which of :data:`SECTORS` equal sectors they lie, from +x on."""
    return np.floor(np.arctan2(y, x) % (2 * np.pi) / (2 * np.pi) * SECTORS).astype(np.int64) % SECTORS


def pair_diversity(counts: PairCounts, firsts: UsedGrasps, seconds: UsedGrasps) -> PairDiversity:
    """Return how different the accepted grasps of one pair are.

    Args:
        firsts, seconds: hold every single grasp that the accepted grasps are made of.
    """
    at0, at1 = (
        np.searchsorted(own.grasp_ids, ids) for own, ids in zip((firsts, seconds), counts.grasp_ids.T, strict=True)
    )
    apart = np.maximum(firsts.distances[np.ix_(at0, at0)], seconds.distances[np.ix_(at1, at1)])
    others = apart[np.triu_indices(len(at0), 1)]
    uses = [*np.unique(at0, return_counts=True)[1], *np.unique(at1, return_counts=True)[1]]
    return PairDiversity(
        first=firsts.object_name,
        second=seconds.object_name,
        grasps=len(at0),
        pinch_grasps=len(np.unique(at0)),
        side_grasps=len(np.unique(at1)),
        most_uses=int(max(uses, default=0)),
        closest=float(others.min()) if len(others) else float("nan"),
        typical=float(np.median(others)) if len(others) else float("nan"),
        sectors0=len(np.unique(firsts.sectors[at0])),
        sectors1=len(np.unique(seconds.sectors[at1])),
    )


def used_ids(counts: Iterable[PairCounts], singles: Iterable[Single]) -> dict[Single, set[int]]:
    """Return the ``grasp_id`` of every single grasp that synthesized two-object grasps are made of."""
    used: dict[Single, set[int]] = {single: set() for single in singles}
    for pair in counts:
        if pair.source == SYNTHESIZED:
            for single, ids in zip(
                (Single("pinch", pair.first), Single("side", pair.second)), pair.grasp_ids.T, strict=True
            ):
                used[single] |= set(ids.tolist())
    return used


def diversity(
    counts: Sequence[PairCounts], validated: Mapping[Single, pd.DataFrame], hand: Hand
) -> tuple[list[UsedGrasps], list[PairDiversity]]:
    """Return the used single grasps of every style and object, and the diversity of every pair.

    Args:
        counts: of all pairs; those of other sources than the synthesis are left out.
        validated: the tables of all objects and styles.
    """
    used = {
        single: used_grasps(hand, single.style, single.object_name, validated[single], ids)
        for single, ids in used_ids(counts, validated).items()
    }
    pairs = [
        pair_diversity(pair, used[Single("pinch", pair.first)], used[Single("side", pair.second)])
        for pair in counts
        if pair.source == SYNTHESIZED
    ]
    return list(used.values()), pairs


def read_validated(singles: Iterable[Single]) -> dict[Single, pd.DataFrame]:
    """Read the validated grasps of some objects.

    Raises:
        UserError: a table is missing or damaged.
    """
    return {
        one: read_table(paths.validated_file(one.style, one.object_name), VALIDATED, f"validate@{one.style}")
        for one in singles
    }
