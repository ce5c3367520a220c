"""What of a drawn condition makes trials fail: success by tercile of every drawn quantity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import rankdata

from pipeline.report.charts import CATEGORY_COLOURS, Table
from pipeline.report.rates import ratio, wilson_interval
from pipeline.report.wording import UNKNOWN, interval, percent

PARTS = ("low", "medium", "high")


@dataclass(frozen=True)
class Part:
    """The trials in one tercile of a quantity."""

    low: float  # smallest value
    high: float  # largest
    trials: int
    successes: int

    @property
    def rate(self) -> float:
        """Successes / trials."""
        return ratio(self.successes, self.trials)


@dataclass(frozen=True)
class Effect:
    """How success depends on one drawn quantity."""

    quantity: str  # with its unit
    parts: Sequence[Part | None]  # low, medium and high tercile; None where equal values leave it empty
    separation: float  # probability that a failed trial drew a larger value than a successful one; nan without either


def drawn_quantities(rows: pd.DataFrame) -> dict[str, NDArray[np.float64]]:
    """Return the quantities (n,) that trials drew, each by its name and unit; vectors by their length."""

    def lengths(column: str, factor: float = 1.0) -> NDArray[np.float64]:
        return factor * np.linalg.norm(np.stack(rows[column].to_list()), axis=1)

    found = {name: rows[key].to_numpy(np.float64) for name, key in _SINGLE.items()}
    errors = np.stack(rows["joint_errors"].to_list())
    found["joint error, root mean square (mrad)"] = 1e3 * np.sqrt((errors**2).mean(axis=1))
    for place, ordinal in enumerate(("first", "second")):
        found[f"mass factor, {ordinal}"] = rows[f"mass_factor{place}"].to_numpy(np.float64)
        found[f"centre of mass off, {ordinal} (mm)"] = lengths(f"centre_offset{place}", 1e3)
        found[f"position error, {ordinal} (mm)"] = lengths(f"position_error{place}", 1e3)
        found[f"rotation error, {ordinal} (°)"] = np.rad2deg(lengths(f"rotation_error{place}"))
        found[f"shove, {ordinal} (N)"] = lengths(f"shove{place}")
    return found


_SINGLE = {
    "friction": "friction",
    "torque limit (N m)": "torque_limit",
    "latency (control periods)": "latency",
}


def effect(quantity: str, values: NDArray[np.float64], success: NDArray[np.bool_]) -> Effect:
    """Return success by tercile of ``values`` (n,), equal values in the same one, and how well they separate.

    The separation is the area under the ROC curve of the failures, from ranks (Mann and Whitney 1947).
    """
    edges = np.quantile(values, [1 / 3, 2 / 3], method="lower") if len(values) else np.zeros(2)
    place = np.searchsorted(edges, values, side="left")
    parts = []
    for number in range(len(PARTS)):
        own = place == number
        known = own.any()
        part = Part(values[own].min(), values[own].max(), int(own.sum()), int(success[own].sum())) if known else None
        parts.append(part)
    failures, successes = int((~success).sum()), int(success.sum())
    separation = float("nan")
    if failures and successes:
        ranks = rankdata(values)[~success].sum()
        separation = float((ranks - failures * (failures + 1) / 2) / (failures * successes))
    return Effect(quantity, parts, separation)


def effects(rows: pd.DataFrame) -> list[Effect]:
    """Return the effect of every drawn quantity on success, the one that separates best first."""
    success = rows["success"].to_numpy(bool)
    found = [effect(name, values, success) for name, values in drawn_quantities(rows).items()]
    return sorted(found, key=lambda one: -abs(np.nan_to_num(one.separation - 0.5)))


def effects_table(found: Sequence[Effect]) -> Table:
    """Return a row per quantity: range, successes and interval of each tercile, and the separation."""
    rows = [[one.quantity, *(_cell(part) for part in one.parts), _number(one.separation)] for one in found]
    headers = [f"{name} third" for name in PARTS]
    return Table(["drawn", *headers, "larger where a trial failed"], rows)


def _cell(part: Part | None) -> str:
    if part is None:
        return UNKNOWN
    known = interval(*wilson_interval(part.successes, part.trials), digits=0)
    return f"{part.low:.3g} to {part.high:.3g}: {percent(part.rate)} ({part.successes} of {part.trials}; {known})"


def _number(value: float) -> str:
    return UNKNOWN if np.isnan(value) else percent(value)


@dataclass(frozen=True)
class Mark:
    """Success in one tercile with its 95 % interval, in units of the SVG."""

    x: float
    low: float
    high: float
    y: float
    colour: str
    text: str


@dataclass(frozen=True)
class EffectChart:
    """A line per quantity with three marks, from no success on the left to all on the right."""

    LEFT: ClassVar[int] = 270
    LENGTH: ClassVar[int] = 600
    TOP: ClassVar[int] = 30
    ROW: ClassVar[int] = 34
    COLOURS: ClassVar[dict[str, str]] = dict(zip(PARTS, CATEGORY_COLOURS[1:4], strict=True))

    title: str
    lines: Sequence[tuple[str, float, Sequence[Mark]]]  # quantity, its place from the top, marks
    numbers: Table


def effect_chart(title: str, found: Sequence[Effect]) -> EffectChart:
    """Return the chart of some effects, with their table."""
    lines = []
    for row, one in enumerate(found):
        top = EffectChart.TOP + row * EffectChart.ROW
        marks = []
        for number, (name, part) in enumerate(zip(PARTS, one.parts, strict=True)):
            if part is None:
                continue
            ends = wilson_interval(part.successes, part.trials)
            x, low, high = (EffectChart.LEFT + EffectChart.LENGTH * value for value in (part.rate, *ends))
            marks.append(Mark(x, low, high, top + 8.0 + 8.0 * number, EffectChart.COLOURS[name], _cell(part)))
        lines.append((one.quantity, top + 20.0, marks))
    return EffectChart(title, lines, effects_table(found))


def distribution_part(title: str, rows: pd.DataFrame) -> EffectChart:
    """Return what of the draws of some trials makes them fail, as a chart with its numbers."""
    return effect_chart(f"Success by what was drawn: {title}", effects(rows))
