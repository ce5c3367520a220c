"""Candidates of a table as arrays, and their rows after physics."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from pipeline.compute.fan_out import Workers
from pipeline.compute.pool import Calls, Work, run_one
from pipeline.compute.shared import Shared
from pipeline.hand.model import Hand
from pipeline.hand.support import Support
from pipeline.physics.holding import Holding
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.records.poses import pose_matrix
from pipeline.records.validation_reasons import ValidationReason
from pipeline.robustness.measures import Measuring
from pipeline.validate.checks import ADDED, Candidate, check_candidate, held_grasp


def candidate_of(row: dict[str, Any], support: Support, hand: Hand) -> Candidate:
    """Return one row of the candidates' table as arrays.

    Args:
        support: what the object stands on.
    """
    return Candidate(
        style=row["style"],
        fingers=tuple(row["fingers"].split("+")),
        T_object_hand=pose_matrix(row["position_object_hand"], row["quaternion_object_hand"]),
        q=np.asarray(row["q"], np.float64),
        contact_candidates=np.asarray(row["contact_candidates"], np.int64),
        contact_normals=np.stack(list(row["contact_normals"])).astype(np.float64),
        support=support,
        hand=hand,
    )


def validate_table(
    candidates: pd.DataFrame,
    prepared: PreparedObject,
    settings: PhysicsParameters,
    limits: ValidateParameters,
    workers: Workers,
    label: str,
    support: Support,
    hand: Hand,
    measuring: Measuring | None = None,
) -> pd.DataFrame:
    """Return all rows in order of ``grasp_id`` with the columns of physics.

    Rows that the synthesis rejected keep their reason; of the others the first ``limits.most_candidates`` are tested
    and the rest are marked ``not_tested``.

    Args:
        support: what the object stands on.
        measuring: what is measured of the grasps that pass; None: nothing.
    """
    return run_one(validation(candidates, prepared, settings, limits, support, hand, measuring), workers, label)


def validation(
    candidates: pd.DataFrame,
    prepared: PreparedObject,
    settings: PhysicsParameters,
    limits: ValidateParameters,
    support: Support,
    hand: Hand,
    measuring: Measuring | None = None,
) -> Work[pd.DataFrame]:
    """Compute what :func:`validate_table` returns, candidate by candidate."""
    rows = candidates.sort_values("grasp_id", kind="stable").reset_index(drop=True)
    passed = [index for index in rows.index if rows.at[index, "rejected_by"] == ""]
    tested, left = passed[: limits.most_candidates], passed[limits.most_candidates :]
    items = [candidate_of(rows.loc[index].to_dict(), support, hand) for index in tested]
    tasks = list(zip(items, _gravities_elsewhere(prepared, items, settings, limits), strict=True))
    with Shared((prepared, settings, limits, measuring)) as shared:
        results = dict(zip(tested, (yield Calls(partial(_check, shared), tasks)), strict=True))
    rejected_by = rows["rejected_by"].tolist()
    for index in left:
        rejected_by[index] = ValidationReason.NOT_TESTED.value
    for index, columns in results.items():
        rejected_by[index] = columns["rejected_by"]
    rows["rejected_by"] = rejected_by
    for name in ADDED:
        rows[name] = pd.Series([results[i][name] if i in results else None for i in rows.index], dtype=object)
    return rows


def _gravities_elsewhere(
    prepared: PreparedObject, candidates: list[Candidate], settings: PhysicsParameters, limits: ValidateParameters
) -> Sequence[Holding | None]:
    """Test the gravities of all candidates on the GPU where ``limits.device`` says so."""
    if limits.device == "cpu" or not candidates:
        return [None] * len(candidates)
    from pipeline.physics.sapien_holding import hold_all_in_gravities

    grasps = [held_grasp(prepared, candidate, limits.squeeze(candidate.style)) for candidate in candidates]
    return hold_all_in_gravities(settings, limits, grasps)


def _check(
    shared: Shared[tuple[PreparedObject, PhysicsParameters, ValidateParameters, Measuring | None]],
    task: tuple[Candidate, Holding | None],
) -> dict[str, Any]:
    prepared, settings, limits, measuring = shared.value
    candidate, holding = task
    return check_candidate(prepared, candidate, settings, limits, holding, measuring)
