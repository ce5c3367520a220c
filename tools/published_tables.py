"""The tables of a published result, as Markdown, from the outputs of the stages: no figure is typed by hand."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from pipeline.records.parameters.pairs import partners
from pipeline.records.series import STAGE, series_of
from pipeline.records.sources import OF_ALL_PAIRS, SOURCES
from pipeline.report.paper import (
    MEAN_SUCCESS,
    MINIMUM_SUCCESS,
    PAIRS,
    PERFECT_CELLS,
    SINGLE_GRASP_SUCCESS,
    TRIALS_PER_PAIR,
)
from pipeline.report.rates import PairTrials, mean, pair_trials, wilson_interval

STANDARD = {name: source.abbreviation for name, source in OF_ALL_PAIRS.items()}
STAGES = ("prepare", "synthesize", "validate", "merge", "train", "sample", "evaluate", STAGE)
BLOCK = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
Parameters = Mapping[str, Any]


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table."""
    table = pd.DataFrame(rows, columns=list(header))
    return table.to_markdown(index=False, tablefmt="github", disable_numparse=True) + "\n"


def percent(value: float, digits: int = 1) -> str:
    """Return a share as text, such as 98.8 %."""
    return f"{100 * value:.{digits}f} %"


def spoken(name: str) -> str:
    """Return an object's name with spaces."""
    return name.replace("_", " ")


def partners_of(parameters: Parameters) -> dict[str, tuple[str, ...]]:
    """Return, for each first object, the objects that are picked after it."""
    styles, pairs = parameters["styles"], parameters.get("pairs", "all")
    if isinstance(pairs, list):
        pairs = [tuple(pair) for pair in pairs]
    return partners(styles["pinch"], styles["side"], pairs, parameters["seed"])


def of_pairs(trials: pd.DataFrame, pairs: Sequence[tuple[str, str]]) -> list[PairTrials]:
    """Count the outcomes of every pair."""
    return [pair_trials(first, second, trials) for first, second in pairs]


def headline(trials: pd.DataFrame, pairs: Sequence[tuple[str, str]]) -> str:
    """Success, both rules, worst pair and pairs at 100 %, of both sources beside the paper's."""
    counts = {source: of_pairs(trials[trials["table"] == source], pairs) for source in STANDARD}

    def row(name: str, paper: Mapping[str, str], value: Any) -> list[str]:
        cells = [text for source in STANDARD for text in (value(counts[source]), paper.get(source, "not published"))]
        return [name, *cells]

    def interval(own: list[PairTrials]) -> str:
        low, high = wilson_interval(sum(pair.successes for pair in own), sum(pair.trials for pair in own))
        return f"{percent(low)} to {percent(high)}"

    rows = [
        row(
            "both 20 cm up for 2 s, mean over pairs",
            {source: percent(value) for source, value in MEAN_SUCCESS.items()},
            lambda own: f"**{percent(mean([pair.success_rate for pair in own]))}**",
        ),
        row("95 % interval of all trials", {}, interval),
        row(
            "worst pair",
            {source: percent(value, 0) for source, value in MINIMUM_SUCCESS.items()},
            lambda own: percent(min(pair.success_rate for pair in own), 0),
        ),
        row(
            "pairs at 100 %",
            {source: str(count) for source, count in PERFECT_CELLS.items()},
            lambda own: str(sum(pair.successes == pair.trials for pair in own)),
        ),
        row(
            "more than 10 cm up at the end of the lift (the released code's rule)",
            {},
            lambda own: percent(mean([pair.success_rate_10cm for pair in own])),
        ),
        row("no motion found", {}, lambda own: str(sum(pair.planning_failures for pair in own))),
        row(
            "pairs, trials",
            dict.fromkeys(STANDARD, f"{PAIRS}, {PAIRS * TRIALS_PER_PAIR}"),
            lambda own: f"{len(own)}, {sum(pair.trials for pair in own)}",
        ),
    ]
    header = [cell for name in STANDARD.values() for cell in (name, f"paper's {name}")]
    return markdown(["", *header], rows)


def matrix(trials: pd.DataFrame, source: str, parameters: Parameters) -> str:
    """Successes of every pair; pairs held out of the training in italics."""
    own, seconds = trials[trials["table"] == source], parameters["styles"]["side"]
    unseen = [tuple(pair) for pair in parameters["train"]["data"]["held_out_pairs"]] if source == "learned" else []
    rows = []
    for first, tried in partners_of(parameters).items():
        cells = dict.fromkeys(seconds, "")
        for pair in of_pairs(own, [(first, second) for second in tried]):
            mark = "*" if (first, pair.second) in unseen else ""
            cells[pair.second] = f"{mark}{pair.successes}{mark}"
        rows.append([spoken(first), *cells.values()])
    return markdown(["first \\ second", *map(spoken, seconds)], rows)


def failures(trials: pd.DataFrame, tables: Sequence[str]) -> str:
    """Failures of each table, counted by reason."""
    failed = trials[~trials["success"]]
    reasons = sorted(failed.loc[failed["table"].isin(tables), "reason"].unique())
    counts = {name: failed.loc[failed["table"] == name, "reason"].value_counts() for name in tables}
    rows = [[f"`{reason}`", *(str(int(counts[name].get(reason, 0))) for name in tables)] for reason in reasons]
    rows.append(["all trials", *(str(int((trials["table"] == name).sum())) for name in tables)])
    return markdown(["reason", *(STANDARD.get(name, f"`{name}`") for name in tables)], rows)


def conditions(trials: pd.DataFrame, parameters: Parameters) -> str:
    """Success of every source under every condition: mean over pairs, 95 % interval of all trials, worst pair."""
    section = parameters["conditions"]
    pairs = {(first, second) for first, second in section["pairs"]}
    cells: dict[str, dict[str, str]] = {}
    for table, own in trials[trials["trial"] < section["trials"]].groupby("table", sort=False):
        series = series_of(str(table))
        source, condition = (series.source, f"`{series.condition}`, {series.engine}") if series else (table, "`paper`")
        tried = of_pairs(own, [pair for pair in _pairs_in(own) if series or pair in pairs])
        low, high = wilson_interval(sum(pair.successes for pair in tried), sum(pair.trials for pair in tried))
        rates = [pair.success_rate for pair in tried]
        text = f"**{percent(mean(rates))}** ({percent(low)} to {percent(high)}), worst {percent(min(rates), 0)}"
        cells.setdefault(condition, {})[str(source)] = text
    sources = list(dict.fromkeys(source for own in cells.values() for source in own))
    rows = [[condition, *(own.get(source, "") for source in sources)] for condition, own in cells.items()]
    return markdown(["condition, engine", *(SOURCES[source].title for source in sources)], rows)


def _pairs_in(trials: pd.DataFrame) -> list[tuple[str, str]]:
    return list(dict.fromkeys(zip(trials["object0"], trials["object1"], strict=True)))


def single_grasps(summary: Mapping[str, Any], durations: Mapping[str, Any], parameters: Parameters) -> str:
    """Chains and survivors of every object beside the paper's Table I, and the cost of each style."""
    rows = []
    for style in ("pinch", "side"):
        names = parameters["styles"][style]
        counts = {
            name: [
                int(summary[f"validate.{style}.{name}.optimised"]),
                int(summary[f"synthesize.{style}.{name}.passed"]),
                int(summary[f"validate.{style}.{name}.validated"]),
            ]
            for name in names
        }
        for name, own in counts.items():
            paper = SINGLE_GRASP_SUCCESS[style].get(name)
            survival = percent(summary[f"validate.{style}.{name}.survival_rate"], 0)
            row = [spoken(name), style, *map(str, own), survival, "" if paper is None else percent(paper), ""]
            rows.append(row)
        chains, passed, validated = (sum(own[column] for own in counts.values()) for column in range(3))
        if validated:
            stages = tuple(f"{stage}@{style}" for stage in ("synthesize", "validate"))
            cost = f"{_cpu_seconds(durations, stages) / validated:.2f}"
            total = [str(chains), str(passed), str(validated), percent(validated / chains, 0)]
            rows.append(["**all**", style, *total, "", cost])
    header = ["object", "style", "chains", "passed", "validated", "survival", "paper", "CPU s per validated"]
    return markdown(header, rows)


def _cpu_seconds(durations: Mapping[str, Mapping[str, float]], stages: tuple[str, ...]) -> float:
    return sum(values["cpu_seconds"] for stage, values in durations.items() if stage.startswith(stages))


def merges(summary: Mapping[str, Any], parameters: Parameters) -> str:
    """Acceptance rate of the merge for every pair, in percent."""
    seconds, rows = parameters["styles"]["side"], []
    for first, tried in partners_of(parameters).items():
        cells = dict.fromkeys(seconds, "")
        cells |= {second: f"{100 * summary[f'merge.{first}--{second}.acceptance_rate']:.0f}" for second in tried}
        rows.append([spoken(first), *cells.values()])
    return markdown(["first \\ second", *map(spoken, seconds)], rows)


def cost(durations: Mapping[str, Mapping[str, float]], trials: pd.DataFrame) -> str:
    """Wall and CPU time and memory of every kind of stage."""
    rows = []
    for kind in STAGES:
        others = [stage for stage in STAGES if stage.startswith(f"{kind}-")]
        left_out = (*others, f"{kind}@reconstructed")
        own = {
            stage: values
            for stage, values in durations.items()
            if stage == kind or stage.startswith((f"{kind}-", f"{kind}@"))
            if not stage.startswith(left_out)
        }
        if not own:
            continue
        longest = max(own, key=lambda stage: own[stage]["wall_seconds"])
        wall, cpu = (sum(values[key] for values in own.values()) for key in ("wall_seconds", "cpu_seconds"))
        memory = max(values["peak_megabytes_largest_process"] for values in own.values())
        row = [f"`{kind}`", str(len(own)), f"{wall / 60:.1f}", f"{cpu / 60:.1f}"]
        rows.append([*row, f"{own[longest]['wall_seconds'] / 60:.1f} (`{longest}`)", f"{memory / 1000:.1f}"])
    standard = trials["table"].isin(list(STANDARD))
    for name, stages, count in (
        ("standard", tuple(f"evaluate@{source}" for source in STANDARD), standard.sum()),
        ("other", (STAGE,), (~standard).sum()),
    ):
        if count:
            rows.append([f"one {name} trial", "", "", f"{_cpu_seconds(durations, stages) / int(count):.2f} s", "", ""])
    return markdown(["stage", "DVC stages", "wall, min", "CPU, min", "longest, min", "largest process, GB"], rows)


def published_tables(
    summary: Mapping[str, Any], durations: Mapping[str, Any], trials: pd.DataFrame, parameters: Parameters
) -> dict[str, str]:
    """Return all tables by name.

    Args:
        summary, durations: ``reports/summary.json`` and ``reports/durations.json``.
        trials: all rows of all trials; ``table`` is the source, or the series or earlier setting.
        parameters: the content of ``params.yaml``.
    """
    pairs = [(first, second) for first, seconds in partners_of(parameters).items() for second in seconds]
    return {
        "success": headline(trials, pairs),
        "synthesized": matrix(trials, "synthesized", parameters),
        "learned": matrix(trials, "learned", parameters),
        "failures": failures(trials, list(STANDARD)),
        "conditions": conditions(trials, parameters),
        "single_grasps": single_grasps(summary, durations, parameters),
        "merges": merges(summary, parameters),
        "cost": cost(durations, trials),
    }


def with_tables(page: str, tables: Mapping[str, str]) -> str:
    """Return the page with every ``<!-- table: name -->`` block holding that table.

    Raises:
        KeyError: the page names a table that does not exist.
    """
    return BLOCK.sub(lambda block: block[1] + tables[block[2]] + block[3], page)
