"""The trials of a pair as rows to read: what happened, by which numbers, and the command that plays it again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from pipeline.report.embedding import FoldedTable
from pipeline.report.wording import SUCCESS, UNKNOWN

HEADERS = (
    "trial",
    "outcome",
    "phase reached",
    "up 10 cm",
    "merged grasp",
    "seed",
    "first off by (mm, mm, °)",
    "second off by (mm, mm, °)",
    "first up (cm)",
    "second up (cm)",
    "second pushed (mm)",
    "grasps planned",
    "physics steps",
)
REPLAY = "run again"


def replay_command(source: str, objects: Sequence[str], trial: int) -> str:
    """Return the command that runs a trial again."""
    return f"./dev replay {'/'.join([source, *objects, str(trial)])}"


def trials_table(source: str, first: str, second: str, trials: pd.DataFrame) -> FoldedTable:
    """Return the trials of one pair; ``trials`` may hold other pairs too."""
    own = trials[(trials["object0"] == first) & (trials["object1"] == second)].sort_values("trial")
    rows = [trial_row(row) for row in own.to_dict("records")]
    commands = [replay_command(source, (first, second), int(trial)) for trial in own["trial"]]
    headers = (*HEADERS[:2], REPLAY, *HEADERS[2:])
    return FoldedTable(headers, [[*row[:2], cell, *row[2:]] for row, cell in zip(rows, commands, strict=True)])


def trial_row(trial: Mapping[Any, Any]) -> list[str]:
    """Return the cells of one trial (a row of a trials table) under ``HEADERS``."""
    return [
        str(trial["trial"]),
        SUCCESS if trial["success"] else str(trial["reason"]),
        str(trial["phase"]),
        "yes" if trial["success_10cm"] else "no",
        str(trial["merged_id"]) if trial["merged_id"] >= 0 else UNKNOWN,
        str(trial["seed"]),
        _offset(trial["offset0"]),
        _offset(trial["offset1"]),
        scaled(trial["height0"], 100.0, 1),
        scaled(trial["height1"], 100.0, 1),
        scaled(trial["push1"], 1000.0, 2),
        str(trial["planning_attempts"]),
        str(trial["steps"]),
    ]


def _offset(offset: Any) -> str:
    x, y, yaw = np.asarray(offset, dtype=np.float64)
    return ", ".join(scaled(*item) for item in ((x, 1000.0, 1), (y, 1000.0, 1), (np.rad2deg(yaw), 1.0, 1)))


def scaled(value: Any, factor: float, digits: int) -> str:
    """Return a figure in another unit as text; a dash where there is none."""
    if value is None or not np.isfinite(value):
        return UNKNOWN
    return f"{round(factor * float(value), digits) + 0.0:.{digits}f}"
