"""The pairs that fare worst, which the page shows where there are too many to show all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pipeline.report.charts import Cell, Link, Table
from pipeline.report.rates import PairTrials, ratio, summed
from pipeline.report.wording import UNKNOWN, pair_key, pair_title

WORST_PAIRS = 50  # with pictures


@dataclass(frozen=True)
class WorstPair:
    """One of the pairs that fare worst."""

    first: str
    second: str
    source: str  # with whose grasps it fares worst
    successes: int  # over all sources
    trials: int


def worst_pairs(trials: Mapping[str, Sequence[PairTrials]], most: int = WORST_PAIRS) -> list[WorstPair]:
    """Return the pairs with the smallest share of successes over the trials of all sources, the worst first.

    A pair without trials counts as one without success; among equals, the order is that of the pairs.
    """
    found: dict[tuple[str, str], list[tuple[str, PairTrials]]] = {}
    for source, pairs in trials.items():
        for pair in pairs:
            found.setdefault((pair.first, pair.second), []).append((source, pair))
    worst = []
    for (first, second), own in found.items():
        source = min(own, key=lambda item: item[1].success_rate)[0]
        successes, tried = sum(pair.successes for _, pair in own), sum(pair.trials for _, pair in own)
        worst.append(WorstPair(first, second, source, successes, tried))
    return sorted(worst, key=lambda one: ratio(one.successes, one.trials))[:most]


def worst_table(worst: Sequence[WorstPair], trials: Mapping[str, Sequence[PairTrials]]) -> Table:
    """Return the pairs that fare worst as links, with their successes per source and their commonest failure."""
    known = {(source, pair.first, pair.second): pair for source, pairs in trials.items() for pair in pairs}
    rows: list[list[Cell]] = []
    for one in worst:
        own = [known.get((source, one.first, one.second)) for source in trials]
        reasons = summed(pair.reasons for pair in own if pair)
        rows.append(
            [
                Link(pair_title(one.first, one.second), pair_key(one.first, one.second)),
                *(f"{pair.successes} of {pair.trials}" if pair else UNKNOWN for pair in own),
                max(reasons, key=lambda reason: reasons[reason], default=UNKNOWN),
            ]
        )
    return Table(["pair", *(f"successes, {source} grasps" for source in trials), "commonest failure"], rows)
