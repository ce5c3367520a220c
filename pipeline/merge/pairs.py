"""All combinations that are tried for one pair of objects."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from pipeline.compute.fan_out import fan_out
from pipeline.merge.combination import Pair, try_combination
from pipeline.merge.draws import Combination, next_combinations, random_order
from pipeline.merge.grasps import SingleGrasp
from pipeline.records.tables import MERGED

CHUNK = 24  # most combinations tried at once; not the number of workers, on which results must not depend
SPARE = 4  # combinations tried at once beyond those still wanted: some will be rejected


def merge_pair(
    pair: Pair,
    firsts: list[SingleGrasp],
    seconds: list[SingleGrasp],
    generator: np.random.Generator,
    workers: int,
) -> pd.DataFrame:
    """Return the table ``MERGED`` of one pair: every tried combination with its fate, in the order of trial.

    Trying ends with ``grasps_per_pair`` accepted rows, with ``most_combinations`` rows, or when nothing is left that
    would not use a single grasp more than ``most_per_grasp`` times.

    Args:
        firsts, seconds: distinct validated grasps of the two objects.
    """
    settings = pair.merge
    pending = random_order(len(firsts), len(seconds), generator)
    rows: list[dict[str, Any]] = []
    accepted: list[Combination] = []
    while len(accepted) < settings.grasps_per_pair and len(rows) < settings.most_combinations:
        wanted = settings.grasps_per_pair - len(accepted)
        count = min(CHUNK, wanted + SPARE, settings.most_combinations - len(rows))
        chunk, pending = next_combinations(pending, accepted, settings.most_per_grasp, count)
        if not chunk:
            break
        label = f"{pair.object0.name}--{pair.object1.name}: {len(accepted)} of {settings.grasps_per_pair}"
        tasks = [(firsts[a], seconds[b]) for a, b in chunk]
        for combination, row in zip(chunk, fan_out(partial(try_combination, pair), tasks, workers, label), strict=True):
            rows.append(row | {"merged_id": len(rows)})
            if row["rejected_by"] == "":
                accepted.append(combination)
            if len(accepted) == settings.grasps_per_pair:
                break
    return pd.DataFrame(rows, columns=MERGED.names, dtype=object)


def summary(table: pd.DataFrame) -> str:
    """Return one line: how many combinations were accepted, and what rejected the others, most frequent first."""
    reasons = table["rejected_by"].value_counts()
    rejected = [f"{reason} {count}" for reason, count in reasons.items() if reason]
    accepted = int((table["rejected_by"] == "").sum())
    return f"{accepted} accepted of {len(table)} tried" + (f" (rejected by {', '.join(rejected)})" if rejected else "")
