"""Static tables and figures as plain values, laid out; ``templates/figures.html`` writes them as HTML and SVG."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from pipeline.report.meanings import meaning_of
from pipeline.report.rates import Spread, ratio
from pipeline.report.wording import UNKNOWN, percent, spoken

PASSED_COLOUR = "#1b7f6b"
# Okabe and Ito's palette (distinct for colour-blind readers), without the green that is close to PASSED_COLOUR.
CATEGORY_COLOURS = ("#e69f00", "#56b4e9", "#cc79a7", "#d55e00", "#0072b2", "#f0e442", "#8c8c8c", "#5b3a8c", "#a8763e")
MOST_CELLS = 256  # of a heat map: the pairs of sixteen objects with sixteen; a map of more is mostly empty
MOST_BARS = 32  # in one piece; more would not fit a sheet of paper
BINS = 20  # of a histogram
PERCENT_EDGES = range(0, 101, 100 // BINS)
_LOW, _HIGH = (251, 243, 226), (20, 110, 95)

Counts = Mapping[str, int]  # per category


@dataclass(frozen=True)
class Link:
    """A cell of a table that leads to another place of the page."""

    text: str
    target: str  # id of an element


Cell = str | Link


@dataclass(frozen=True)
class Table:
    """Cells under their headers; the first of each row is the row's own header."""

    headers: Sequence[str]
    rows: Sequence[Sequence[Cell]]


def spread_table(first_column: str, rows: Sequence[tuple[str, int, Spread, int]]) -> Table:
    """Return how values are distributed: title, number of values, spread and digits of each row."""
    cells = [
        [title, str(count)]
        + [
            f"{value:.{digits}f}" if count else UNKNOWN
            for value in (own.mean, own.least, own.quartile_1, own.median, own.quartile_3, own.most)
        ]
        for title, count, own, digits in rows
    ]
    return Table([first_column, "values", "mean", "least", "quartile 1", "median", "quartile 3", "most"], cells)


def explanations(checks: Iterable[str], meanings: Mapping[str, str]) -> list[tuple[str, str]]:
    """Return what ``checks`` mean, in the order in which they are made; those that share a meaning share a line."""
    lines: dict[str, list[str]] = {}
    for check in sorted(set(checks)):
        lines.setdefault(meaning_of(check, meanings), []).append(spoken(check))
    return [(", ".join(lines[text]), text) for text in meanings.values() if text in lines]


@dataclass(frozen=True)
class HeatCell:
    """A coloured cell that leads to what it is about."""

    rate: float  # 0 to 1
    note: str  # small, under the rate, such as 24 of 25
    target: str  # id of an element

    @property
    def colour(self) -> tuple[int, int, int]:
        """RGB, 0 to 255."""
        return scale_colour(self.rate)

    @property
    def ink(self) -> str:
        """Colour of the text."""
        return ink_on(self.colour)


@dataclass(frozen=True)
class HeatMap:
    """A table of coloured cells."""

    rows: Sequence[str]
    columns: Sequence[str]
    cells: Mapping[tuple[str, str], HeatCell]  # per (row, column); others are empty

    @property
    def numbers(self) -> Table:
        """The notes as a plain table."""
        links = {key: Link(cell.note, cell.target) for key, cell in self.cells.items()}
        rows = [[spoken(row), *(links.get((row, column), "") for column in self.columns)] for row in self.rows]
        return Table(["first \\ second", *map(spoken, self.columns)], rows)


def scale_colour(rate: float) -> tuple[int, int, int]:
    """Return the colour of a rate (0 to 1) on the scale of the heat maps, RGB 0-255."""
    t = min(max(rate, 0.0), 1.0)
    r, g, b = (round(low + t * (high - low)) for low, high in zip(_LOW, _HIGH, strict=True))
    return r, g, b


def ink_on(colour: tuple[int, int, int]) -> str:
    """Return black or white, whichever reads better on ``colour`` (luma of ITU-R BT.601)."""
    return "#fff" if 0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2] < 140 else "#111"


@dataclass(frozen=True)
class Segment:
    """The part of a bar that one category has."""

    category: str
    count: int
    share: float  # of the bar
    x: float
    width: float
    colour: str


@dataclass(frozen=True)
class Bar:
    """One horizontal bar."""

    label: str
    total: int
    segments: Sequence[Segment]


@dataclass(frozen=True)
class LegendEntry:
    """A category's name beside its colour."""

    x: int
    y: int
    text: str
    colour: str


@dataclass(frozen=True)
class BarChart:
    """Horizontal bars of shares, all of the same length. Lengths are units of the SVG."""

    LEFT: ClassVar[int] = 250
    LENGTH: ClassVar[int] = 640
    WIDTH: ClassVar[int] = LEFT + LENGTH + 60
    ROW: ClassVar[int] = 26

    title: str
    first_column: str  # header of the bars' labels
    categories: Sequence[str]
    legend: Sequence[LegendEntry]
    bars: Sequence[Bar]

    @property
    def sheets(self) -> list[tuple[Sequence[LegendEntry], int, Sequence[Bar]]]:
        """The bars in parts that fit a sheet of paper: legend (of the first part only), its height, bars."""
        height = max((entry.y for entry in self.legend), default=0) + 24
        parts = range(0, max(len(self.bars), 1), MOST_BARS)
        return [(() if i else self.legend, 0 if i else height, self.bars[i : i + MOST_BARS]) for i in parts]

    @property
    def numbers(self) -> Table:
        """Counts and shares of all bars."""
        rows = []
        for bar in self.bars:
            counts = {segment.category: segment for segment in bar.segments}
            cells = [
                f"{counts[c].count} ({percent(counts[c].share)})" if c in counts else f"0 ({percent(0)})"
                for c in self.categories
            ]
            rows.append([bar.label, str(bar.total), *cells])
        return Table([self.first_column, "all", *map(spoken, self.categories)], rows)


def stacked_bars(bars: Sequence[tuple[str, Counts]], passed: str, title: str, first_column: str) -> BarChart:
    """Return bars of the shares of all categories.

    Args:
        bars: label and counts of each.
        passed: the category drawn first and in its own colour.
        title: read out by screen readers.
        first_column: what the labels are, such as ``pair``.
    """
    categories = ordered_categories(bars, passed)
    colours = category_colours(categories, passed)
    drawn = []
    for label, counts in bars:
        total, x, segments = sum(counts.values()), float(BarChart.LEFT), []
        for category in categories:
            share = ratio(counts.get(category, 0), total)
            width = share * BarChart.LENGTH
            if share > 0:
                segments.append(Segment(category, counts[category], share, x, width, colours[category]))
            x += width
        drawn.append(Bar(label, total, segments))
    return BarChart(title, first_column, categories, _legend(categories, colours), drawn)


def _legend(categories: Sequence[str], colours: Mapping[str, str]) -> list[LegendEntry]:
    entries, x, y = [], 4, 4
    for category in categories:
        text = spoken(category)
        length = 24 + 7.2 * len(text) + 16  # an estimate for the page's 13 px letters
        if x + length > BarChart.WIDTH and x > 4:
            x, y = 4, y + 20
        entries.append(LegendEntry(x, y, text, colours[category]))
        x += int(length)
    return entries


def ordered_categories(bars: Sequence[tuple[str, Counts]], passed: str) -> list[str]:
    """Return all categories of the bars: ``passed`` first, the others sorted by name."""
    others = {category for _, counts in bars for category in counts} - {passed}
    return [passed, *sorted(others)]


def category_colours(categories: Sequence[str], passed: str) -> dict[str, str]:
    """Give every category a colour; past the palette's end, colours repeat."""
    others = [category for category in categories if category != passed]
    colours = {category: CATEGORY_COLOURS[i % len(CATEGORY_COLOURS)] for i, category in enumerate(others)}
    return {passed: PASSED_COLOUR, **colours}


@dataclass(frozen=True)
class Histogram:
    """How many values are in which bin. Lengths are units of the SVG."""

    LEFT: ClassVar[int] = 60
    TOP: ClassVar[int] = 12
    WIDTH: ClassVar[int] = 640
    HEIGHT: ClassVar[int] = 150
    COLOUR: ClassVar[str] = PASSED_COLOUR

    title: str
    axis: str  # what the values are, with their unit
    counted: str  # what is counted, such as ``pairs``
    edges: Sequence[float]
    counts: Sequence[int]

    @cached_property
    def most(self) -> int:
        """Count of the highest bar, at least 1."""
        return max([*self.counts, 1])

    @property
    def step(self) -> float:
        """Width of a bin."""
        return self.WIDTH / len(self.counts)

    @property
    def bars(self) -> list[tuple[float, float, str, int]]:
        """Left edge, height, bin and count of every bar."""
        return [
            (self.LEFT + i * self.step, self.HEIGHT * count / self.most, self._bin(i), count)
            for i, count in enumerate(self.counts)
        ]

    @property
    def ticks(self) -> list[tuple[float, str]]:
        """Places and numbers under the axis."""
        count = len(self.counts)
        shown = sorted({0, count // 4, count // 2, 3 * count // 4, count})
        return [(self.LEFT + i * self.step, f"{self.edges[i]:g}") for i in shown]

    @property
    def numbers(self) -> Table:
        """The counts as a table."""
        return Table([self.axis, self.counted], [[self._bin(i), str(count)] for i, count in enumerate(self.counts)])

    def _bin(self, index: int) -> str:
        return f"{self.edges[index]:g} to {self.edges[index + 1]:g}"


def histogram(values: Sequence[float], edges: Sequence[float], title: str, axis: str, counted: str) -> Histogram:
    """Return the histogram of some values; see :class:`Histogram`.

    Args:
        edges: of the bins, rising; a bin holds its lower edge, the last one its upper edge too. Values beyond the last
            edge are counted in the last bin, values below the first in the first.
    """
    counts, _ = np.histogram(np.clip(np.asarray(values, np.float64), edges[0], edges[-1]), edges)
    return Histogram(title, axis, counted, edges, counts.tolist())


@dataclass(frozen=True)
class Curve:
    """One line of a diagram."""

    name: str
    colour: str
    points: Sequence[tuple[float, float]]  # in units of the SVG


@dataclass(frozen=True)
class Curves:
    """Lines over a common axis, both axes beginning at 0. Lengths are units of the SVG."""

    LEFT: ClassVar[int] = 60
    TOP: ClassVar[int] = 30
    WIDTH: ClassVar[int] = 640
    HEIGHT: ClassVar[int] = 220

    title: str
    axis: str  # what the last number of the horizontal axis counts
    last: float  # that number
    levels: Sequence[tuple[float, float]]  # horizontal lines: place and value
    curves: Sequence[Curve]
    numbers: Table


def curves(x: Sequence[float], lines: Mapping[str, Sequence[float]], title: str, axis: str) -> Curves:
    """Return curves over ``x``, and their numbers.

    Args:
        x: no negative ones, of all lines.
        lines: values by name, none negative.
        axis: what ``x`` counts, such as ``steps``.
    """
    last, most = max(x), max(value for values in lines.values() for value in values)
    drawn = []
    for index, (name, values) in enumerate(lines.items()):
        points = [
            (Curves.LEFT + Curves.WIDTH * a / last, Curves.TOP + Curves.HEIGHT * (1 - b / most))
            for a, b in zip(x, values, strict=True)
        ]
        drawn.append(Curve(name, CATEGORY_COLOURS[(4, 0, 2)[index]], points))
    levels = [(Curves.TOP + Curves.HEIGHT * (1 - share), most * share) for share in (0.0, 0.5, 1.0)]
    rows = [[f"{a:g}", *(f"{b:.5g}" for b in own)] for a, *own in zip(x, *lines.values(), strict=True)]
    return Curves(title, axis, last, levels, drawn, Table([axis.removesuffix("s"), *lines], rows))
