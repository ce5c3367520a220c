"""``reports/pairs.parquet``: one row per pair and source of grasps, with every figure that is known of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from pipeline.report.counting import SYNTHESIZED, PairCounts
from pipeline.report.rates import wilson_interval

_COUNTS = pa.map_(pa.string(), pa.int32())


def _column(name: str, kind: pa.DataType, description: str) -> pa.Field:
    return pa.field(name, kind, metadata={"description": description})


PAIRS = pa.schema(
    [
        _column("first", pa.string(), "object picked first, held by thumb, index and middle finger"),
        _column("second", pa.string(), "object picked second, held by ring finger and palm"),
        _column("source", pa.string(), "where the grasps come from: synthesized, learned or reconstructed"),
        _column("tried", pa.int32(), "combinations (synthesized) or ranked samples (the others) that were checked"),
        _column("accepted", pa.int32(), "of these, two-object grasps that passed every check"),
        _column("acceptance_rate", pa.float64(), "accepted / tried, 0 where nothing was tried"),
        _column("rejected", _COUNTS, "check -> combinations or samples that failed it first"),
        _column("pinch_grasps", pa.int32(), "distinct pinch grasps among the accepted ones; synthesized only"),
        _column("side_grasps", pa.int32(), "distinct side grasps among the accepted ones; synthesized only"),
        _column("most_uses", pa.int32(), "accepted grasps that share the commonest single grasp; synthesized only"),
        _column(
            "drift_mm_median",
            pa.float64(),
            "mm, median over accepted grasps of the largest motion of an object in the hand under gravity",
        ),
        _column("trained", pa.bool_(), "whether the model was trained on grasps of the pair; learned only"),
        _column(
            "overlap_mm_median",
            pa.float64(),
            "mm, median over accepted samples of the deepest overlap of hand and objects",
        ),
        _column(
            "contact_distance_mm_median",
            pa.float64(),
            "mm, median over accepted samples of the mean distance of the assigned contacts to the surfaces",
        ),
        _column("overlap_mm_median_raw", pa.float64(), "the same of all samples as the model drew them"),
        _column("contact_distance_mm_median_raw", pa.float64(), "the same of all samples as the model drew them"),
        _column("trials", pa.int32(), "trials with the whole robot"),
        _column("successes", pa.int32(), "of these, with both objects at the height of success for as long as asked"),
        _column("success_rate", pa.float64(), "successes / trials, 0 without trials"),
        _column("success_low", pa.float64(), "lower end of the 95 % score interval of the rate (Wilson)"),
        _column("success_high", pa.float64(), "upper end of it"),
        _column("successes_10cm", pa.int32(), "successes by the released code's rule: both more than 10 cm up"),
        _column("planning_failures", pa.int32(), "trials that ended because no motion was found"),
        _column("grasps_planned", pa.int32(), "two-object grasps for which moves were sought"),
        _column("grasps_in_reach", pa.int32(), "of these, grasps with moves for both picks"),
        _column("failed", _COUNTS, "reason -> trials that ended for it"),
    ]
)


def pairs_table(counts: Sequence[PairCounts], quality: Mapping[str, Mapping[tuple[str, str], Any]]) -> pd.DataFrame:
    """Return the rows of :data:`PAIRS`, in the order of ``counts``.

    Args:
        quality: per source of samples and pair, what ``quality.json`` holds.
    """
    rows = [pair_row(one, quality.get(one.source, {}).get((one.first, one.second), {})) for one in counts]
    return pd.DataFrame(rows, columns=PAIRS.names)


def pair_row(counts: PairCounts, quality: Mapping[str, Any]) -> dict[str, Any]:
    """Return one row; ``quality`` holds the figures of the samples, none for synthesized grasps."""
    grasps, trials = counts.grasps, counts.trials
    low, high = wilson_interval(trials.successes, trials.trials)
    drifts = counts.drifts[np.isfinite(counts.drifts)]
    row: dict[str, Any] = {
        "first": counts.first,
        "second": counts.second,
        "source": counts.source,
        "tried": grasps.tried,
        "accepted": grasps.accepted,
        "acceptance_rate": grasps.acceptance_rate,
        "rejected": list(grasps.rejected.items()),
        "drift_mm_median": 1000 * float(np.median(drifts)) if len(drifts) else None,
        "trained": quality.get("trained"),
        "trials": trials.trials,
        "successes": trials.successes,
        "success_rate": trials.success_rate,
        "success_low": low,
        "success_high": high,
        "successes_10cm": trials.successes_10cm,
        "planning_failures": trials.planning_failures,
        "grasps_planned": trials.attempts,
        "grasps_in_reach": trials.planned,
        "failed": list(trials.reasons.items()),
    }
    for state, end in (("ranked", ""), ("raw", "_raw")):
        own = quality.get(state) or {}
        row[f"overlap_mm_median{end}"] = own.get("penetration_mm_median")
        row[f"contact_distance_mm_median{end}"] = own.get("contact_distance_mm_median")
    pinch, side, most = uses(counts) if counts.source == SYNTHESIZED else (None, None, None)
    return row | {"pinch_grasps": pinch, "side_grasps": side, "most_uses": most}


def uses(counts: PairCounts) -> tuple[int, int, int]:
    """Return how many distinct pinch and side grasps the accepted grasps have, and the uses of the commonest."""
    pinch, side = (Counter(column.tolist()) for column in counts.grasp_ids.T)
    return len(pinch), len(side), max([*pinch.values(), *side.values()], default=0)
