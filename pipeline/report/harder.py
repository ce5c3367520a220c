"""Harder settings beside the standard trials: the same pairs, grasps and seeds, so that trials compare one to one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import pandas as pd
from markupsafe import Markup

from pipeline.records import paths
from pipeline.records.flat import PAIR_TRIALS, read_flat
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.harder import HarderParameters, HarderSetting
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.report.charts import Cell, Link, Table, explanations, stacked_bars
from pipeline.report.counting import trials_of
from pipeline.report.meanings import TRIALS as REASONS
from pipeline.report.rates import MOST_PAIRS, PairTrials, mean, pair_trials, ratio, summed
from pipeline.report.rendering import render
from pipeline.report.settings import described
from pipeline.report.wording import HARDER, SUCCESS, pair_title, percent, trials_key

IDENTITY = ["object0", "object1", "trial"]


@dataclass(frozen=True)
class Change:
    """One parameter that a setting replaces."""

    name: str
    standard: str
    here: str
    meaning: str


@dataclass(frozen=True)
class Harder:
    """One setting."""

    name: str
    source: str  # of the grasps
    changes: Sequence[Change]
    pairs: Sequence[PairTrials]
    standard: Sequence[PairTrials]  # of the same trials in the standard setting
    rows: pd.DataFrame  # its table of trials
    lost: int  # trials that succeed in the standard setting and not here
    gained: int  # the other way round

    @property
    def trials(self) -> int:
        """Trials of all pairs."""
        return sum(pair.trials for pair in self.pairs)

    @property
    def shown(self) -> list[tuple[str, str]]:
        """The pairs that the page shows one by one: all, or none where there are many."""
        return [(pair.first, pair.second) for pair in self.pairs] if len(self.pairs) <= MOST_PAIRS else []


def load_harder(
    parameters: HarderParameters,
    evaluate: EvaluateParameters,
    physics: PhysicsParameters,
) -> list[Harder]:
    """Read the tables of all settings and compare them with the standard trials.

    Args:
        evaluate, physics: of the standard trials.

    Raises:
        UserError: a table is missing or damaged.
    """
    pairs = [(first, second) for first, second in parameters.pairs]
    firsts = dict.fromkeys(first for first, _ in pairs)
    found = []
    for name, setting in parameters.settings.items():
        rows = read_flat(paths.harder_file(name), PAIR_TRIALS, "evaluate-harder")
        standard = pd.concat([read_flat(*trials_of(setting.source, first)) for first in firsts])
        found.append(compared(name, setting, rows, standard, pairs, changes_of(setting, evaluate, physics)))
    return found


def changes_of(setting: HarderSetting, evaluate: EvaluateParameters, physics: PhysicsParameters) -> list[Change]:
    """Return what a setting replaces, with the meaning that the parameters' own types give."""
    changes = []
    for section, standard in (("evaluate", evaluate), ("physics", physics)):
        for key, value in getattr(setting, section).items():
            name, meaning = f"{section}.{key}", type(standard).model_fields[key].description or ""
            (before,), (here,) = described(name, getattr(standard, key)), described(name, value)
            changes.append(Change(name, before[1], here[1], meaning))
    return changes


def compared(
    name: str,
    setting: HarderSetting,
    rows: pd.DataFrame,
    standard: pd.DataFrame,
    pairs: Sequence[tuple[str, str]],
    changes: Sequence[Change],
) -> Harder:
    """Count one setting's trials, and the standard trials of the same pairs and numbers, ``standard`` may hold more."""
    both = rows[[*IDENTITY, "success"]].merge(standard, on=IDENTITY, suffixes=("", "_standard"), validate="1:1")
    same = standard.merge(rows[IDENTITY], on=IDENTITY, validate="1:1")
    here, there = both["success"].astype(bool), both["success_standard"].astype(bool)
    return Harder(
        name=name,
        source=setting.source,
        changes=changes,
        pairs=[pair_trials(first, second, rows) for first, second in pairs],
        standard=[pair_trials(first, second, same) for first, second in pairs],
        rows=rows,
        lost=int((there & ~here).sum()),
        gained=int((here & ~there).sum()),
    )


def reasons_of(pairs: Sequence[PairTrials]) -> dict[str, int]:
    """Return how many trials of all pairs ended for which reason, sorted by reason."""
    return summed(pair.reasons for pair in pairs)


def harder_summary(found: Sequence[Harder]) -> dict[str, float | int]:
    """Return the settings' part of the summary; the shares of failures are added by the caller."""
    values: dict[str, float | int] = {}
    for one in found:
        prefix = f"evaluate.harder.{one.name}"
        values |= {
            f"{prefix}.trials": one.trials,
            f"{prefix}.success_rate_mean": mean([pair.success_rate for pair in one.pairs]),
            f"{prefix}.success_rate_min_pair": min((pair.success_rate for pair in one.pairs), default=0.0),
            f"{prefix}.success_rate_mean_10cm": mean([pair.success_rate_10cm for pair in one.pairs]),
            f"{prefix}.planning_failure_rate": ratio(sum(pair.planning_failures for pair in one.pairs), one.trials),
            f"{prefix}.standard_success_rate_mean": mean([pair.success_rate for pair in one.standard]),
            f"{prefix}.standard_success_rate_mean_10cm": mean([pair.success_rate_10cm for pair in one.standard]),
            f"{prefix}.lost": ratio(one.lost, one.trials),
            f"{prefix}.gained": ratio(one.gained, one.trials),
        }
        for pair in one.pairs if len(one.pairs) <= MOST_PAIRS else ():
            item = f"{prefix}.{pair.first}--{pair.second}"
            values |= {f"{item}.success_rate": pair.success_rate, f"{item}.success_rate_10cm": pair.success_rate_10cm}
    return values


Column = tuple[str, str, Sequence[PairTrials]]  # title, source of its trials as in their ids, counts


def _columns(found: Sequence[Harder]) -> list[Column]:
    """Return the columns: the standard trials of each source, then the settings with its grasps."""
    columns: list[Column] = []
    for source in dict.fromkeys(one.source for one in found):
        own = [one for one in found if one.source == source]
        columns.append((f"standard, {source} grasps", source, own[0].standard))
        columns += [(f"{one.name}, {source} grasps", HARDER + one.name, one.pairs) for one in own]
    return columns


def _rates_table(found: Sequence[Harder], released_rule: bool) -> Table:
    """Return success per pair and column, each a link to the trials; by the released code's rule or by the paper's.

    Past ``MOST_PAIRS`` pairs, only the means are listed.
    """
    columns = _columns(found)
    rows: list[list[Cell]] = []
    for index, pair in enumerate(columns[0][2] if found[0].shown else ()):
        cells = []
        for _, source, pairs in columns:
            own = pairs[index]
            count = own.successes_10cm if released_rule else own.successes
            text = f"{percent(ratio(count, own.trials))} ({count} of {own.trials})"
            cells.append(Link(text, trials_key(source, pair.first, pair.second)))
        rows.append([pair_title(pair.first, pair.second), *cells])
    means = [
        percent(mean([pair.success_rate_10cm if released_rule else pair.success_rate for pair in pairs]))
        for _, _, pairs in columns
    ]
    return Table(["pair", *(title for title, _, _ in columns)], [*rows, ["mean over pairs", *means]])


def _trial_by_trial(found: Sequence[Harder], criterion: str) -> Table:
    rows = [
        [one.name, str(one.trials), percent(mean([pair.success_rate for pair in one.pairs]))]
        + [percent(min(pair.success_rate for pair in one.pairs))]
        + [percent(mean([pair.success_rate_10cm for pair in one.pairs]))]
        + [f"{count} ({percent(ratio(count, one.trials))})" for count in (one.lost, one.gained)]
        for one in found
    ]
    headers = ["setting", "trials", f"mean success ({criterion})", "worst pair", "mean success (10 cm)"]
    return Table([*headers, "lost", "gained"], rows)


def harder_section(found: Sequence[Harder], criterion: str, hand_torque_limit: float) -> Markup:
    """Return what each setting changes, and success by both rules, losses and reasons beside the standard trials.

    Args:
        criterion: the paper's rule in short, such as ``20 cm, 2 s``.
        hand_torque_limit: of the standard trials, N m.
    """
    changed = [
        [one.name, change.name, change.standard, change.here, change.meaning] for one in found for change in one.changes
    ]
    bars = [
        (title, {SUCCESS: sum(pair.successes for pair in pairs), **reasons_of(pairs)})
        for title, _, pairs in _columns(found)
    ]
    return render(
        "harder.html",
        hand_torque_limit=f"{hand_torque_limit:g}",
        criterion=criterion,
        changes=Table(["setting", "parameter", "standard", "here", "meaning"], changed),
        success=_rates_table(found, released_rule=False),
        success_10cm=_rates_table(found, released_rule=True),
        compared=_trial_by_trial(found, criterion),
        outcomes=stacked_bars(bars, SUCCESS, "Outcomes of trials per setting", "setting"),
        reasons=explanations((reason for _, counts in bars for reason in counts if reason != SUCCESS), REASONS),
    )
