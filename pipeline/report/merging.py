"""Merging: what became of the combinations of single grasps that were tried for every pair."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from pipeline.report.charts import BINS, explanations, histogram, spread_table, stacked_bars
from pipeline.report.counting import SYNTHESIZED, PairCounts
from pipeline.report.meanings import MERGE
from pipeline.report.rates import MOST_PAIRS, PairMerge, spread, summed
from pipeline.report.rendering import render
from pipeline.report.wording import PASSED, pair_title


def merge_section(merges: Sequence[PairMerge], counts: Sequence[PairCounts], drift_limit: float) -> Markup:
    """Return the outcomes of all combinations per pair; of many pairs, distributions of counts and drift.

    Args:
        counts: of all sources; only those of synthesized grasps count.
        drift_limit: largest motion in the hand that passes, m.
    """
    rejected = summed(merge.rejected for merge in merges)
    reasons = explanations(rejected, MERGE)
    if len(merges) <= MOST_PAIRS:
        bars = [(pair_title(m.first, m.second), {PASSED: m.accepted, **m.rejected}) for m in merges]
        outcomes = stacked_bars(bars, PASSED, "Outcomes of combinations per pair", "pair")
        return render("merge.html", outcomes=outcomes, reasons=reasons)
    accepted = [merge.accepted for merge in merges]
    drifts = np.concatenate([np.zeros(0), *(1000 * one.drifts for one in counts if one.source == SYNTHESIZED)])
    drifts = drifts[np.isfinite(drifts)]
    step = -(-max([*accepted, 1]) // BINS)
    figures = [
        ("accepted grasps", len(merges), spread(accepted), 1),
        ("accepted / tried (%)", len(merges), spread([100 * merge.acceptance_rate for merge in merges]), 1),
        ("drift of accepted grasps (mm)", len(drifts), spread(drifts), 2),
    ]
    title = "Accepted grasps per pair"
    edges = [round(1000 * drift_limit * i / BINS, 6) for i in range(BINS + 1)]
    bars = [("all pairs", {PASSED: sum(accepted), **rejected})]
    return render(
        "merge_of_many.html",
        spread=spread_table("of a pair", figures),
        accepted=histogram(accepted, range(0, step * BINS + 1, step), title, "accepted grasps of a pair", "pairs"),
        drifts=histogram(drifts.tolist(), edges, "Drift of accepted grasps", "drift in the hand (mm)", "grasps"),
        outcomes=stacked_bars(bars, PASSED, "Outcomes of combinations", "pairs"),
        reasons=reasons,
    )
