"""How often the robot succeeds with the grasps of one source: beside the paper, per pair or over many, and why not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from markupsafe import Markup

from pipeline.report import paper
from pipeline.report.charts import (
    MOST_CELLS,
    PERCENT_EDGES,
    Cell,
    HeatCell,
    HeatMap,
    Link,
    Table,
    explanations,
    histogram,
    spread_table,
    stacked_bars,
)
from pipeline.report.embedding import FoldedTable
from pipeline.report.meanings import TRIALS
from pipeline.report.rates import MOST_PAIRS, PairTrials, mean, ratio, spread, summed, wilson_interval
from pipeline.report.rendering import render
from pipeline.report.summary import Value
from pipeline.report.wording import (
    PLACES,
    SUCCESS,
    UNKNOWN,
    interval,
    objects_key,
    pair_title,
    percent,
    spoken,
    trials_key,
)

WORST_OBJECTS = 10  # of each place in a pair
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


def success_section(source: str, pairs: Sequence[PairTrials], summary: Mapping[str, Value], criterion: str) -> Markup:
    """Return rates and failure reasons of one source of grasps: of every pair, or of many taken together.

    Args:
        criterion: the paper's rule of success in short, such as ``20 cm, 2 s``.
    """
    published = paper_table(source, pairs)
    return (
        _of_many(source, pairs, criterion, published)
        if len(pairs) > MOST_PAIRS
        else _of_each(source, pairs, summary, criterion, published)
    )


def _of_each(
    source: str, pairs: Sequence[PairTrials], summary: Mapping[str, Value], criterion: str, published: Table
) -> Markup:
    bars = [(pair_title(p.first, p.second), {SUCCESS: p.successes, **p.reasons}) for p in pairs]
    return render(
        "success.html",
        heat_map=success_map(source, pairs),
        published=published,
        pairs=pairs_table(source, pairs, summary, criterion),
        outcomes=stacked_bars(bars, SUCCESS, "Outcomes of trials per pair", "pair"),
        reasons=explanations((reason for p in pairs for reason in p.reasons), TRIALS),
    )


def success_map(source: str, pairs: Sequence[PairTrials]) -> HeatMap | None:
    """Return the success of every pair, each cell leading to its trials; None where too few cells would be filled."""
    firsts, seconds = list(dict.fromkeys(p.first for p in pairs)), list(dict.fromkeys(p.second for p in pairs))
    if len(firsts) * len(seconds) > MOST_CELLS:
        return None
    cells = {
        (p.first, p.second): HeatCell(
            p.success_rate,
            f"{p.successes} of {p.trials}" if p.trials else "no trials",
            trials_key(source, p.first, p.second),
        )
        for p in pairs
    }
    return HeatMap(firsts, seconds, cells)


def pairs_table(source: str, pairs: Sequence[PairTrials], summary: Mapping[str, Value], criterion: str) -> Table:
    """Return every pair's rates with intervals, and the means of the summary."""
    headers = ["pair", "trials", "successes", f"success ({criterion})", "95 % interval", "success (10 cm)"]
    headers += ["no plan found", "grasps in reach"]
    rows: list[list[Cell]] = [
        [
            Link(pair_title(p.first, p.second), trials_key(source, p.first, p.second)),
            *(str(p.trials), str(p.successes), percent(p.success_rate)),
            interval(*wilson_interval(p.successes, p.trials), digits=0),
            *(percent(p.success_rate_10cm), percent(p.planning_failure_rate), percent(p.reachable_rate)),
        ]
        for p in pairs
    ]

    def overall(key: str) -> str:
        return percent(float(summary[f"evaluate.{source}.{key}"]))

    means = ["mean over pairs", str(summary[f"evaluate.{source}.trials"]), str(sum(p.successes for p in pairs))]
    means += [overall("success_rate_mean"), "", overall("success_rate_mean_10cm")]
    means += [overall("planning_failure_rate"), overall("reachable_rate")]
    return Table(headers, [*rows, means])


def paper_table(source: str, pairs: Sequence[PairTrials]) -> Table:
    """Return the known figures of the published heat map beside ours."""
    rates = [pair.success_rate for pair in pairs]
    perfect = sum(pair.trials > 0 and pair.successes == pair.trials for pair in pairs)
    published, least = paper.MEAN_SUCCESS.get(source), paper.MINIMUM_SUCCESS.get(source)
    numbers = " / ".join(map(str, sorted({pair.trials for pair in pairs})))
    return Table(
        ["", "here", "paper"],
        [
            ["mean over pairs", percent(mean(rates)), UNKNOWN if published is None else percent(published)],
            [
                "worst pair",
                percent(min(rates, default=0.0)),
                UNKNOWN if least is None else f"{percent(least)} (with the lemon)",
            ],
            ["pairs at 100 %", str(perfect), str(paper.PERFECT_CELLS.get(source, UNKNOWN))],
            ["pairs", str(len(pairs)), str(paper.PAIRS)],
            ["trials per pair", numbers, str(paper.TRIALS_PER_PAIR)],
        ],
    )


def _of_many(source: str, pairs: Sequence[PairTrials], criterion: str, published: Table) -> Markup:
    rates = [100 * pair.success_rate for pair in pairs]
    figures = [
        (f"success, {criterion} (%)", rates),
        ("success, 10 cm (%)", [100 * pair.success_rate_10cm for pair in pairs]),
        ("no plan found (%)", [100 * pair.planning_failure_rate for pair in pairs]),
        ("grasps in reach (%)", [100 * pair.reachable_rate for pair in pairs]),
    ]
    reasons = summed(pair.reasons for pair in pairs)
    bars = [("all pairs", {SUCCESS: sum(pair.successes for pair in pairs), **reasons})]
    places = []
    for place, words in PLACES.items():
        rows = object_rows(pairs, place)
        places.append((words, objects_key(source, place), len(rows), Table(OBJECT_HEADERS, rows[:WORST_OBJECTS])))
    return render(
        "success_of_many.html",
        count=len(pairs),
        spread=spread_table("of a pair", [(title, len(pairs), spread(values), 1) for title, values in figures]),
        published=published,
        rates=histogram(rates, PERCENT_EDGES, "Success per pair", f"success of a pair, {criterion} (%)", "pairs"),
        places=places,
        outcomes=stacked_bars(bars, SUCCESS, "Outcomes of trials", "pairs"),
        reasons=explanations(reasons, TRIALS),
    )


def object_rows(pairs: Sequence[PairTrials], place: str) -> list[list[str]]:
    """Return one row per object under ``OBJECT_HEADERS``, the one with the smallest share of successes first."""
    groups: dict[str, list[PairTrials]] = {}
    for pair in pairs:
        groups.setdefault(getattr(pair, place), []).append(pair)
    ordered = sorted(groups.items(), key=lambda item: mean([pair.success_rate for pair in item[1]]))
    return [[spoken(name), *_object_cells(own)] for name, own in ordered]


def _object_cells(own: Sequence[PairTrials]) -> list[str]:
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


def object_tables(trials: Mapping[str, Sequence[PairTrials]]) -> dict[str, FoldedTable]:
    """Return, by id, the tables of all objects of the sources that have too many pairs to show each."""
    return {
        objects_key(source, place): FoldedTable(OBJECT_HEADERS, object_rows(pairs, place))
        for source, pairs in trials.items()
        if len(pairs) > MOST_PAIRS
        for place in PLACES
    }
