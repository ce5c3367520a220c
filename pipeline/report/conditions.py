"""Trials under other conditions beside the standard ones: the same pairs, grasps and seeds, compared one to one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import pandas as pd
from markupsafe import Markup

from pipeline.records.flat import PAIR_TRIALS, read_flat
from pipeline.records.parameters import Parameters
from pipeline.records.parameters.conditions import Condition, DistributionParameters
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.series import STAGE, TrialSeries
from pipeline.records.sources import SOURCES
from pipeline.report.charts import Cell, Link, Table, explanations, stacked_bars
from pipeline.report.counting import trials_of
from pipeline.report.distribution import distribution_part
from pipeline.report.meanings import TRIALS as REASONS
from pipeline.report.rates import MOST_PAIRS, PairTrials, mean, pair_trials, ratio, summed, wilson_interval
from pipeline.report.rendering import render
from pipeline.report.settings import described
from pipeline.report.wording import SOURCE_TITLES, SUCCESS, UNKNOWN, interval, pair_title, percent, spoken, trials_key

IDENTITY = ["object0", "object1", "trial"]


@dataclass(frozen=True)
class Change:
    """One parameter that a condition replaces, or one range from which it draws."""

    condition: str
    name: str
    standard: str
    here: str
    meaning: str


@dataclass(frozen=True)
class Tried:
    """One series of trials, and the standard trials of the same pairs and numbers."""

    series: TrialSeries
    pairs: Sequence[PairTrials]
    standard: Sequence[PairTrials]
    rows: pd.DataFrame  # its trials
    lost: int  # trials that succeed in the standard series and not here
    gained: int  # the other way round
    is_standard: bool = False

    @property
    def trials(self) -> int:
        """Trials of all pairs."""
        return sum(pair.trials for pair in self.pairs)

    @property
    def successes(self) -> int:
        """Successes of all pairs."""
        return sum(pair.successes for pair in self.pairs)

    @property
    def drawn(self) -> bool:
        """Whether its trials drew from a distribution."""
        return bool(self.rows["friction"].notna().any())

    @property
    def shown(self) -> list[tuple[str, str]]:
        """The pairs that the page shows one by one: all, or none where there are many."""
        return [(pair.first, pair.second) for pair in self.pairs] if len(self.pairs) <= MOST_PAIRS else []

    @property
    def key(self) -> str:
        """What stands in the place of a source in the ids of its trials."""
        return self.series.source if self.is_standard else str(self.series)


@dataclass(frozen=True)
class Conditions:
    """All series of a run."""

    tried: Sequence[Tried] = ()
    changes: Sequence[Change] = ()


def load_conditions(parameters: Parameters) -> Conditions:
    """Read the tables of all series and compare them with the standard trials.

    Raises:
        UserError: a table is missing or damaged.
    """
    conditions, evaluate, physics = parameters.conditions, parameters.evaluate, parameters.physics
    own = [(first, second) for first, second in conditions.pairs]
    photographed = [(first, second) for first, item in parameters.reconstructed.items() for second in item.side]
    found = []
    of_source: dict[str, pd.DataFrame] = {}
    for series in conditions.series(bool(parameters.reconstructed)):
        pairs = own if SOURCES[series.source].of_all_pairs else photographed
        if series.source not in of_source:
            firsts = dict.fromkeys(first for first, _ in pairs)
            standard = pd.concat([read_flat(*trials_of(series.source, first)) for first in firsts])
            of_source[series.source] = standard[standard["trial"] < conditions.trials]
        same = conditions.is_standard(series, evaluate, physics)
        rows = of_source[series.source] if same else read_flat(series.table, PAIR_TRIALS, STAGE)
        found.append(compared(series, rows, of_source[series.source], pairs, same))
    changes = [
        change
        for name, condition in conditions.settings.items()
        for change in changes_of(name, condition, conditions.distribution, evaluate, physics)
    ]
    return Conditions(found, changes)


def changes_of(
    name: str,
    condition: Condition,
    distribution: DistributionParameters,
    evaluate: EvaluateParameters,
    physics: PhysicsParameters,
) -> list[Change]:
    """Return what a condition replaces or draws, with the meaning that the parameters' own types give."""
    changes = []
    for section, standard, values in (
        ("evaluate", evaluate, condition.evaluate),
        ("physics", physics, condition.changes),
    ):
        for key, value in values.items():
            full, meaning = f"{section}.{key}", type(standard).model_fields[key].description or ""
            (before,), (here,) = described(full, getattr(standard, key)), described(full, value)
            changes.append(Change(name, full, before[1], here[1], meaning))
    if condition.drawn:
        for key, item in type(distribution).model_fields.items():
            full = f"conditions.distribution.{key}"
            (here,) = described(full, getattr(distribution, key))
            changes.append(Change(name, full, UNKNOWN, here[1], item.description or ""))
    return changes


def compared(
    series: TrialSeries,
    rows: pd.DataFrame,
    standard: pd.DataFrame,
    pairs: Sequence[tuple[str, str]],
    is_standard: bool = False,
) -> Tried:
    """Count one series, and the standard trials of the same pairs and numbers, of which ``standard`` may hold more."""
    own = rows.merge(pd.DataFrame(pairs, columns=IDENTITY[:2]), on=IDENTITY[:2])
    both = own[[*IDENTITY, "success"]].merge(standard, on=IDENTITY, suffixes=("", "_standard"), validate="1:1")
    same = standard.merge(own[IDENTITY], on=IDENTITY, validate="1:1")
    here, there = both["success"].astype(bool), both["success_standard"].astype(bool)
    return Tried(
        series=series,
        pairs=[pair_trials(first, second, own) for first, second in pairs],
        standard=[pair_trials(first, second, same) for first, second in pairs],
        rows=own,
        lost=int((there & ~here).sum()),
        gained=int((here & ~there).sum()),
        is_standard=is_standard,
    )


def reasons_of(pairs: Sequence[PairTrials]) -> dict[str, int]:
    """Return how many trials of all pairs ended for which reason, sorted by reason."""
    return summed(pair.reasons for pair in pairs)


def series_prefix(series: TrialSeries) -> str:
    """Return how the summary's keys on a series begin."""
    return f"evaluate.conditions.{series.condition}.{series.engine}.{series.source}"


def conditions_summary(tried: Sequence[Tried]) -> dict[str, float | int]:
    """Return the part of the summary on all series; the shares of failures are added by the caller."""
    values: dict[str, float | int] = {}
    for one in tried:
        prefix = series_prefix(one.series)
        values |= {
            f"{prefix}.trials": one.trials,
            f"{prefix}.success_rate_mean": mean([pair.success_rate for pair in one.pairs]),
            f"{prefix}.success_rate_min_pair": min((pair.success_rate for pair in one.pairs), default=0.0),
            f"{prefix}.success_rate_mean_10cm": mean([pair.success_rate_10cm for pair in one.pairs]),
            f"{prefix}.planning_failure_rate": ratio(sum(pair.planning_failures for pair in one.pairs), one.trials),
            f"{prefix}.standard_success_rate_mean": mean([pair.success_rate for pair in one.standard]),
            f"{prefix}.lost": ratio(one.lost, one.trials),
            f"{prefix}.gained": ratio(one.gained, one.trials),
        }
        for pair in one.pairs if len(one.pairs) <= MOST_PAIRS else ():
            values[f"{prefix}.{pair.first}--{pair.second}.success_rate"] = pair.success_rate
    return values


def column_title(series: TrialSeries) -> str:
    """Return what a condition in an engine is called."""
    return f"{spoken(series.condition)}, {series.engine}"


def success_table(tried: Sequence[Tried]) -> Table:
    """Return success of every source (rows) under every condition in every engine (columns).

    A cell: mean over pairs, 95 % interval of all trials, the worst pair.
    """
    columns = list(dict.fromkeys(column_title(one.series) for one in tried))
    cells: dict[str, dict[str, str]] = {}
    for one in tried:
        rates = [pair.success_rate for pair in one.pairs]
        known = interval(*wilson_interval(one.successes, one.trials), digits=1)
        text = f"{percent(mean(rates))} ({known}; worst pair {percent(min(rates, default=0.0))})"
        cells.setdefault(one.series.source, {})[column_title(one.series)] = text
    rows = [[SOURCE_TITLES[source], *(own.get(column, "") for column in columns)] for source, own in cells.items()]
    return Table(["grasps", *columns], rows)


def pairs_table(source: str, tried: Sequence[Tried]) -> Table:
    """Return successes of every pair (rows) of a source in its series (columns), each a link to the trials.

    Past ``MOST_PAIRS`` pairs there are no rows.
    """
    own = [one for one in tried if one.series.source == source]
    rows: list[list[Cell]] = []
    for index, (first, second) in enumerate(own[0].shown):
        counts = [(one.key, one.pairs[index]) for one in own]
        links = [Link(f"{pair.successes} of {pair.trials}", trials_key(key, first, second)) for key, pair in counts]
        rows.append([pair_title(first, second), *links])
    return Table(["pair", *(column_title(one.series) for one in own)], rows)


def _trial_by_trial(tried: Sequence[Tried]) -> Table:
    rows = [
        [_bar_title(one), str(one.trials), percent(mean([pair.success_rate for pair in one.pairs]))]
        + [percent(mean([pair.success_rate_10cm for pair in one.pairs]))]
        + [percent(ratio(sum(pair.planning_failures for pair in one.pairs), one.trials))]
        + [f"{count} ({percent(ratio(count, one.trials))})" for count in (one.lost, one.gained)]
        for one in tried
    ]
    return Table(["trials", "number", "mean success", "by 10 cm", "no plan found", "lost", "gained"], rows)


def _bar_title(one: Tried) -> str:
    return f"{column_title(one.series)}, {spoken(one.series.source)}"


def conditions_section(found: Conditions, criterion: str, hand_torque_limit: float) -> Markup:
    """Return what each condition changes, the table of success, losses and reasons, and what of a draw matters.

    Args:
        criterion: the paper's rule in short, such as ``20 cm, 2 s``.
        hand_torque_limit: of the standard trials, N m.
    """
    changed = [[one.condition, one.name, one.standard, one.here, one.meaning] for one in found.changes]
    bars = [(_bar_title(one), {SUCCESS: one.successes, **reasons_of(one.pairs)}) for one in found.tried]
    sources = dict.fromkeys(one.series.source for one in found.tried)
    together: dict[str, list[pd.DataFrame]] = {}
    for one in found.tried:
        if one.drawn:
            together.setdefault(column_title(one.series), []).append(one.rows)
    return render(
        "conditions.html",
        hand_torque_limit=f"{hand_torque_limit:g}",
        criterion=criterion,
        changes=Table(["condition", "parameter", "standard", "here", "meaning"], changed),
        success=success_table(found.tried),
        pairs=[(SOURCE_TITLES[source], pairs_table(source, found.tried)) for source in sources],
        compared=_trial_by_trial(found.tried),
        outcomes=stacked_bars(bars, SUCCESS, "Outcomes of trials per condition", "trials"),
        reasons=explanations((reason for _, counts in bars for reason in counts if reason != SUCCESS), REASONS),
        drawn=[distribution_part(title, pd.concat(rows)) for title, rows in together.items()],
    )
