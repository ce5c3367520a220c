"""What the page shows past ``rates.MOST_PAIRS`` pairs: distributions, objects, and the pairs that fare worst."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from pipeline.report import paper
from pipeline.report.charts import (
    Cell,
    Link,
    bars_with_table,
    histogram,
    percent,
    spread_table,
    table,
)
from pipeline.report.counting import PairCounts
from pipeline.report.embedding import FoldedTable, fold
from pipeline.report.meanings import MERGE, SYNTHESIS, TRIALS, VALIDATION, explained
from pipeline.report.rates import Funnel, PairMerge, PairTrials, mean, ratio, spread, summed

WORST_PAIRS = 50  # with pictures
WORST_OBJECTS = 10  # of each place in a pair
BINS = 20
PERCENT_EDGES = tuple(range(0, 101, 100 // BINS))
PLACES = {"first": "picked up first", "second": "picked up second"}
OBJECT_HEADERS = (
    "object",
    "pairs",
    "trials",
    "successes",
    "success",
    "success of its worst pair",
    "no plan found",
    "grasps in reach",
)
SINGLE_HEADERS = (
    "object",
    "chains",
    "passed the filter",
    "validated",
    "validated / chains",
    "paper: successes / batch",
    "validated / passed",
    "paper’s contact rule",
)


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


def _spoken(name: str) -> str:
    return name.replace("_", " ")


def _of_objects(pairs: Sequence[PairTrials], place: str) -> list[list[str]]:
    """Return one row per object under ``OBJECT_HEADERS``, the one with the smallest share of successes first."""
    groups: dict[str, list[PairTrials]] = {}
    for pair in pairs:
        groups.setdefault(getattr(pair, place), []).append(pair)
    ordered = sorted(groups.items(), key=lambda item: mean([pair.success_rate for pair in item[1]]))
    return [[_spoken(name), *_cells(own)] for name, own in ordered]


def _cells(own: Sequence[PairTrials]) -> list[str]:
    trials = sum(pair.trials for pair in own)
    return [
        str(len(own)),
        str(trials),
        str(sum(pair.successes for pair in own)),
        percent(mean([pair.success_rate for pair in own])),
        percent(min(pair.success_rate for pair in own)),
        percent(ratio(sum(pair.planning_failures for pair in own), trials)),
        percent(ratio(sum(pair.planned for pair in own), sum(pair.attempts for pair in own))),
    ]


def objects_key(source: str, place: str) -> str:
    """Return the id of the table of all objects at one place of a pair."""
    return f"objects-{source}-{place}"


def singles_key(style: str) -> str:
    """Return the id of the table of all objects in one style."""
    return f"singles-{style}"


def object_tables(trials: Mapping[str, Sequence[PairTrials]]) -> dict[str, FoldedTable]:
    """Return, by id, the tables of all objects of the sources in ``trials``."""
    return {
        objects_key(source, place): FoldedTable(OBJECT_HEADERS, _of_objects(pairs, place))
        for source, pairs in trials.items()
        for place in PLACES
    }


def single_tables(funnels: Sequence[Funnel]) -> dict[str, FoldedTable]:
    """Return, by id, the tables of all objects per style."""
    return {
        singles_key(style): FoldedTable(SINGLE_HEADERS, [single_row(one) for one in own])
        for style, own in _by_style(funnels).items()
    }


def single_row(funnel: Funnel) -> list[str]:
    """Return the figures of one object in one style under ``SINGLE_HEADERS``."""
    published = paper.SINGLE_GRASP_SUCCESS.get(funnel.style, {}).get(funnel.object_name)
    contact_only = ratio(funnel.contact_only_passed, funnel.contact_only_tested)
    return [
        f"{_spoken(funnel.object_name)} ({funnel.style})",
        str(funnel.optimised),
        str(funnel.passed),
        str(funnel.validated),
        percent(funnel.survival_rate),
        percent(published) if published is not None else "–",
        percent(funnel.survival_rate_of_passed),
        f"{funnel.contact_only_passed} of {funnel.contact_only_tested} ({percent(contact_only)})",
    ]


def _by_style(funnels: Sequence[Funnel]) -> dict[str, list[Funnel]]:
    return {style: [one for one in funnels if one.style == style] for style in dict.fromkeys(f.style for f in funnels)}


def every_row() -> str:
    """Return the sentence that leads to the table of all pairs, with a line of Python that reads it."""
    code = 'pandas.read_parquet("reports/pairs.parquet").sort_values("success_rate")'
    return (
        '<p>Every pair is a row of <a href="pairs.parquet">reports/pairs.parquet</a>, which itself says what its '
        f"columns mean: <code>{escape(code)}</code>.</p>\n"
    )


def success_of_many(source: str, pairs: Sequence[PairTrials], criterion: str, published: str) -> str:
    """Return distributions over pairs and objects of one source.

    Args:
        criterion: the paper's rule of success in short.
        published: the paper's figures beside ours, as HTML.
    """
    count = len(pairs)
    figures = [
        (f"success, {criterion} (%)", [100 * pair.success_rate for pair in pairs]),
        ("success, 10 cm (%)", [100 * pair.success_rate_10cm for pair in pairs]),
        ("no plan found (%)", [100 * pair.planning_failure_rate for pair in pairs]),
        ("grasps in reach (%)", [100 * pair.reachable_rate for pair in pairs]),
    ]
    rates = [100 * pair.success_rate for pair in pairs]
    reasons = summed(pair.reasons for pair in pairs)
    bars = [("all pairs", {"success": sum(pair.successes for pair in pairs), **reasons})]
    parts = [
        f"<p>{count} pairs are too many to show one by one.</p>\n{every_row()}",
        spread_table("of a pair", [(title, count, spread(values), 1) for title, values in figures]),
        f'<div class="beside">{published}</div>\n',
        "<h3>Success per pair</h3>\n",
        histogram(rates, PERCENT_EDGES, "Success per pair", f"success of a pair, {criterion} (%)", "pairs"),
    ]
    for place, words in PLACES.items():
        rows = _of_objects(pairs, place)
        parts += [
            f"<h3>Objects {words}</h3>\n<p>The {min(WORST_OBJECTS, len(rows))} of {len(rows)} that fare worst, mean "
            "over their pairs.</p>\n",
            table(OBJECT_HEADERS, rows[:WORST_OBJECTS]),
            fold(objects_key(source, place), f"All {len(rows)} objects {words}"),
        ]
    parts += [
        "<h3>Why trials failed</h3>\n",
        bars_with_table(bars, "success", "Outcomes of trials", "pairs"),
        explained(reasons, TRIALS),
    ]
    return "".join(parts)


def worst_table(worst: Sequence[WorstPair], trials: Mapping[str, Sequence[PairTrials]], key: str) -> str:
    """Return the pairs that fare worst as a table of links.

    Args:
        key: what the ids of pairs begin with.
    """
    known = {(source, pair.first, pair.second): pair for source, pairs in trials.items() for pair in pairs}
    rows: list[list[Cell]] = []
    for one in worst:
        cells: list[Cell] = [Link(f"{_spoken(one.first)} + {_spoken(one.second)}", f"{key}{one.first}--{one.second}")]
        for source in trials:
            pair = known.get((source, one.first, one.second))
            cells.append(f"{pair.successes} of {pair.trials}" if pair else "–")
        reasons = summed(
            pair.reasons for source in trials if (pair := known.get((source, one.first, one.second))) is not None
        )
        commonest = max(reasons, key=lambda reason: reasons[reason], default="–")
        rows.append([*cells, commonest])
    headers = ["pair", *(f"successes, {source} grasps" for source in trials), "commonest failure"]
    return table(headers, rows)


def merges_of_many(merges: Sequence[PairMerge], counts: Iterable[PairCounts], drift_limit: float) -> str:
    """Return distributions of the merging over pairs, and of the drift of accepted grasps.

    Args:
        counts: of the synthesized grasps.
        drift_limit: largest motion in the hand that passes, m.
    """
    accepted = [merge.accepted for merge in merges]
    drifts = np.concatenate([np.zeros(0), *(1000 * one.drifts for one in counts)])
    drifts = drifts[np.isfinite(drifts)]
    most, limit = max([*accepted, 1]), 1000 * drift_limit
    step = -(-most // BINS)
    figures = [
        ("accepted grasps", len(merges), spread(accepted), 1),
        ("accepted / tried (%)", len(merges), spread([100 * merge.acceptance_rate for merge in merges]), 1),
        ("drift of accepted grasps (mm)", len(drifts), spread(drifts), 2),
    ]
    rejected = summed(merge.rejected for merge in merges)
    return (
        "<p>Combinations of a pinch grasp and a side grasp that were tried for each pair, by the first check that they "
        "failed. Combinations are tried in random order until enough are accepted, so the counts differ. Drift: the "
        "largest motion of an object in the hand over the gravity directions, both objects held.</p>\n"
        + spread_table("of a pair", figures)
        + "<h3>Accepted grasps per pair</h3>\n"
        + histogram(
            accepted, range(0, step * BINS + 1, step), "Accepted grasps per pair", "accepted grasps of a pair", "pairs"
        )
        + "<h3>Drift of accepted grasps</h3>\n"
        + histogram(
            drifts.tolist(),
            [round(limit * i / BINS, 6) for i in range(BINS + 1)],
            "Drift of accepted grasps",
            "drift in the hand (mm)",
            "grasps",
        )
        + "<h3>Combinations by the first check that they failed</h3>\n"
        + bars_with_table(
            [("all pairs", {"passed": sum(accepted), **rejected})], "passed", "Fate of combinations", "pairs"
        )
        + explained(rejected, MERGE)
    )


def singles_of_many(funnels: Sequence[Funnel]) -> str:
    """Return distributions over objects per style, and what chains and grasps were rejected by."""
    styles = _by_style(funnels)
    parts = [
        spread_table(
            "of an object",
            [
                (f"{title}, {style}", len(own), spread(values(own)), digits)
                for style, own in styles.items()
                for title, values, digits in (
                    ("validated grasps", lambda own: [one.validated for one in own], 1),
                    ("validated / chains (%)", lambda own: [100 * one.survival_rate for one in own], 1),
                    ("validated / passed (%)", lambda own: [100 * one.survival_rate_of_passed for one in own], 1),
                )
            ],
        )
    ]
    for style, own in styles.items():
        rates = [100 * one.survival_rate for one in own]
        parts += [
            f"<h3>Objects, {escape(style)} grasps</h3>\n",
            histogram(
                rates, PERCENT_EDGES, f"Validated / chains, {style}", "validated / chains of an object (%)", "objects"
            ),
            fold(singles_key(style), f"All {len(own)} objects, {style}"),
        ]
    synthesis = {style: summed(one.synthesize_rejected for one in own) for style, own in styles.items()}
    physics = {style: summed(one.validate_rejected for one in own) for style, own in styles.items()}
    chains = [(style, {"passed": sum(f.passed for f in own), **synthesis[style]}) for style, own in styles.items()]
    tested = [(style, {"passed": sum(f.validated for f in own), **physics[style]}) for style, own in styles.items()]
    parts += [
        "<h3>Synthesis: chains by the first check of the filter that they failed</h3>\n",
        bars_with_table(chains, "passed", "Fate of chains", "style"),
        explained(summed(synthesis.values()), SYNTHESIS),
        "<h3>Validation: grasps that passed the filter, by the first check of physics that they failed</h3>\n",
        bars_with_table(tested, "passed", "Fate of tested grasps", "style"),
        explained(summed(physics.values()), VALIDATION),
    ]
    return "".join(parts)
