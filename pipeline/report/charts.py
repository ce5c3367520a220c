"""Static figures as HTML and SVG text: they need no script, print as seen, and have the same bytes every time."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from urllib.parse import quote

import numpy as np

from pipeline.report.rates import Spread, ratio

PASSED_COLOUR = "#1b7f6b"
# Okabe and Ito's palette (distinct for colour-blind readers), without the green that is close to PASSED_COLOUR.
CATEGORY_COLOURS = ("#e69f00", "#56b4e9", "#cc79a7", "#d55e00", "#0072b2", "#f0e442", "#8c8c8c", "#5b3a8c", "#a8763e")
MOST_CELLS = 256  # of a heat map: the pairs of sixteen objects with sixteen; a map of more is mostly empty
MOST_BARS = 32  # in one piece; more would not fit a sheet of paper
_LOW, _HIGH = (251, 243, 226), (20, 110, 95)


def percent(rate: float) -> str:
    """Return a rate as text with one decimal, such as 82.7 %."""
    return f"{100 * rate:.1f}\u202f%"


@dataclass(frozen=True)
class Link:
    """A cell of a table that leads to another place of the page."""

    text: str
    target: str  # id of an element


Cell = str | Link


def data_uri(picture: bytes) -> str:
    """Return a JPEG or WebP as a data URI."""
    kind = "webp" if picture[8:12] == b"WEBP" else "jpeg"
    return f"data:image/{kind};base64," + base64.b64encode(picture).decode()


def image(picture: bytes, alternative: str, shape: tuple[int, int]) -> str:
    """Return a picture that is decoded when it is near the window; its place is kept for it from the beginning.

    Args:
        shape: width and height in any unit.
    """
    width, height = shape
    return (
        f'<img src="{data_uri(picture)}" alt="{escape(alternative)}" width="{width}" height="{height}" loading="lazy">'
    )


def anchor(target: str) -> str:
    """Return the ``href`` that leads to the element with the id ``target``."""
    return "#" + quote(target)


def _cell(cell: Cell) -> str:
    if isinstance(cell, Link):
        return f'<a href="{anchor(cell.target)}">{escape(cell.text)}</a>'
    return escape(cell)


def scale_colour(rate: float) -> tuple[int, int, int]:
    """Return the colour of a rate (0 to 1) on the scale of the heat maps, RGB 0-255."""
    t = min(max(rate, 0.0), 1.0)
    r, g, b = (round(low + t * (high - low)) for low, high in zip(_LOW, _HIGH, strict=True))
    return r, g, b


def ink_on(colour: tuple[int, int, int]) -> str:
    """Return black or white, whichever reads better on ``colour`` (luma of ITU-R BT.601)."""
    return "#fff" if 0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2] < 140 else "#111"


def table(headers: Sequence[str], rows: Sequence[Sequence[Cell]], caption: str = "") -> str:
    """Return an HTML table of escaped texts; the first column is a row header, the others are figures."""
    head = "".join(f'<th scope="col">{escape(text)}</th>' for text in headers)
    body = "".join(
        "<tr>"
        + "".join(
            f'<th scope="row">{_cell(cell)}</th>' if column == 0 else f"<td>{_cell(cell)}</td>"
            for column, cell in enumerate(row)
        )
        + "</tr>\n"
        for row in rows
    )
    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    return f'<div class="wide"><table>{title}<thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody></table></div>\n'


def numbers(title: str, html: str) -> str:
    """Return the numbers of a figure, folded under it; on paper they are open."""
    return f'<details class="numbers"><summary>{escape(title)}</summary>\n{html}</details>\n'


def heat_map(
    row_names: Sequence[str],
    column_names: Sequence[str],
    rates: Mapping[tuple[str, str], float],
    notes: Mapping[tuple[str, str], str],
    targets: Mapping[tuple[str, str], str],
) -> str:
    """Return a heat map as a table of coloured cells, each a link.

    Args:
        rates: 0 to 1 per (row, column); a pair without a rate has an empty cell.
        notes: small text under each rate, such as 24 of 25.
        targets: id of the element that each cell leads to.
    """
    head = "".join(f'<th scope="col">{escape(_spoken(name))}</th>' for name in column_names)
    body = ""
    for row in row_names:
        body += f'<tr><th scope="row">{escape(_spoken(row))}</th>'
        for column in column_names:
            if (row, column) not in rates:
                body += "<td></td>"
                continue
            colour = scale_colour(rates[row, column])
            body += (
                f'<td style="background:rgb{colour}"><a href="{anchor(targets[row, column])}" '
                f'style="color:{ink_on(colour)}"><b>{percent(rates[row, column])}</b>'
                f"<small>{escape(notes[row, column])}</small></a></td>"
            )
        body += "</tr>\n"
    header = f"<thead><tr><th></th>{head}</tr></thead>"
    return f'<div class="wide"><table class="heat">{header}<tbody>{body}</tbody></table></div>\n'


def matrix(
    row_names: Sequence[str], column_names: Sequence[str], cells: Mapping[tuple[str, str], Cell], corner: str
) -> str:
    """Return the numbers of a heat map as a plain table; missing cells are empty."""
    rows = [[_spoken(row), *(cells.get((row, column), "") for column in column_names)] for row in row_names]
    return table([corner, *map(_spoken, column_names)], rows)


def _spoken(name: str) -> str:
    return name.replace("_", " ")


def stacked_bars(bars: Sequence[tuple[str, Mapping[str, int]]], passed: str, title: str) -> str:
    """Return horizontal bars of shares as SVG, in parts that fit a sheet of paper; the first has the legend.

    Args:
        bars: label and counts per category; bars are drawn to the same length.
        passed: the category drawn first and in its own colour.
        title: read out by screen readers.
    """
    categories = ordered_categories(bars, passed)
    colours = category_colours(categories, passed)
    parts = range(0, max(len(bars), 1), MOST_BARS)
    return "".join(_bars(bars[i : i + MOST_BARS], categories, colours, title, legend=i == 0) for i in parts)


def _bars(
    bars: Sequence[tuple[str, Mapping[str, int]]],
    categories: Sequence[str],
    colours: Mapping[str, str],
    title: str,
    legend: bool,
) -> str:
    row_height, left, width = 26, 250, 640
    drawn, legend_height = _legend(categories, colours, left + width + 60) if legend else ("", 0)
    height = legend_height + row_height * len(bars) + 4
    parts = [
        f'<svg class="bars" viewBox="0 0 {left + width + 60} {height}" role="img" aria-label="{escape(title)}">',
        drawn,
    ]
    for index, (label, counts) in enumerate(bars):
        y, x, total = legend_height + index * row_height, float(left), sum(counts.values())
        parts.append(f'<text x="{left - 8}" y="{y + 16}" text-anchor="end">{escape(label)}</text>')
        for category in categories:
            share = ratio(counts.get(category, 0), total)
            if share > 0:
                parts.append(
                    f'<rect x="{x:.2f}" y="{y + 2}" width="{share * width:.2f}" height="{row_height - 6}" '
                    f'fill="{colours[category]}"><title>{escape(label)}: {escape(_spoken(category))} '
                    f"{counts[category]} of {total} ({percent(share)})</title></rect>"
                )
            x += share * width
        parts.append(f'<text x="{left + width + 8}" y="{y + 16}">{total}</text>')
    return "\n".join([*parts, "</svg>\n"])


def _legend(categories: Sequence[str], colours: Mapping[str, str], width: int) -> tuple[str, int]:
    """Return the legend's SVG and its height; entries wrap at ``width``."""
    parts, x, y = [], 4, 4
    for category in categories:
        text = _spoken(category)
        length = 24 + 7.2 * len(text) + 16  # an estimate for the page's 13 px letters
        if x + length > width and x > 4:
            x, y = 4, y + 20
        parts.append(
            f'<rect x="{x:.0f}" y="{y}" width="12" height="12" fill="{colours[category]}"/>'
            f'<text x="{x + 17:.0f}" y="{y + 11}">{escape(text)}</text>'
        )
        x += int(length)
    return "\n".join(parts), y + 24


def ordered_categories(bars: Sequence[tuple[str, Mapping[str, int]]], passed: str) -> list[str]:
    """Return all categories of the bars: ``passed`` first, the others sorted by name."""
    others = {category for _, counts in bars for category in counts} - {passed}
    return [passed, *sorted(others)]


def category_colours(categories: Sequence[str], passed: str) -> dict[str, str]:
    """Give every category a colour; past the palette's end, colours repeat."""
    others = [category for category in categories if category != passed]
    colours = {category: CATEGORY_COLOURS[i % len(CATEGORY_COLOURS)] for i, category in enumerate(others)}
    return {passed: PASSED_COLOUR, **colours}


def bars_with_table(bars: Sequence[tuple[str, Mapping[str, int]]], passed: str, title: str, first_column: str) -> str:
    """Return stacked bars and, folded under them, the same counts with their shares."""
    categories = ordered_categories(bars, passed)
    rows = []
    for label, counts in bars:
        total = sum(counts.values())
        cells = [f"{counts.get(c, 0)} ({percent(ratio(counts.get(c, 0), total))})" for c in categories]
        rows.append([label, str(total), *cells])
    headers = [first_column, "all", *(_spoken(category) for category in categories)]
    return stacked_bars(bars, passed, title) + numbers(f"{title}: numbers", table(headers, rows))


def spread_table(first_column: str, rows: Sequence[tuple[str, int, Spread, int]]) -> str:
    """Return how values are distributed: title, number of values, spread and digits of each row."""
    cells = [
        [title, str(count)]
        + [
            f"{value:.{digits}f}"
            for value in (own.mean, own.least, own.quartile_1, own.median, own.quartile_3, own.most)
        ]
        if count
        else [title, "0", *["–"] * 6]
        for title, count, own, digits in rows
    ]
    return table([first_column, "values", "mean", "least", "quartile 1", "median", "quartile 3", "most"], cells)


def histogram(values: Sequence[float], edges: Sequence[float], title: str, axis: str, counted: str) -> str:
    """Return a histogram as SVG and, folded under it, its numbers.

    Args:
        edges: of the bins, rising; a bin holds its lower edge, the last one its upper edge too. Values beyond the last
            edge are counted in the last bin, values below the first in the first.
        axis: what the values are, with their unit.
        counted: what is counted, such as ``pairs``.
    """
    counts, _ = np.histogram(np.clip(np.asarray(values, np.float64), edges[0], edges[-1]), edges)
    left, top, width, height = 60, 12, 640, 150
    most, bar = max(int(counts.max()), 1), width / len(counts)
    parts = [
        f'<svg class="bars histogram" viewBox="0 0 {left + width + 20} {top + height + 44}" role="img" '
        f'aria-label="{escape(title)}">',
        f'<text x="{left - 8}" y="{top + 10}" text-anchor="end">{most}</text>',
        f'<text x="{left - 8}" y="{top + height}" text-anchor="end">0</text>',
        f'<line x1="{left}" x2="{left + width}" y1="{top + height}" y2="{top + height}" stroke="#999"/>',
    ]
    rows = []
    for index, count in enumerate(counts.tolist()):
        low, high = f"{edges[index]:g}", f"{edges[index + 1]:g}"
        tall = height * count / most
        parts.append(
            f'<rect x="{left + index * bar + 1:.2f}" y="{top + height - tall:.2f}" width="{bar - 2:.2f}" '
            f'height="{tall:.2f}" fill="{PASSED_COLOUR}"><title>{low} to {high}: {count}</title></rect>'
        )
        rows.append([f"{low} to {high}", str(count)])
    for index in sorted({0, len(counts) // 4, len(counts) // 2, 3 * len(counts) // 4, len(counts)}):
        x = left + index * bar
        parts.append(f'<text x="{x:.1f}" y="{top + height + 17}" text-anchor="middle">{edges[index]:g}</text>')
    parts.append(f'<text x="{left + width / 2}" y="{top + height + 36}" text-anchor="middle">{escape(axis)}</text>')
    parts.append("</svg>\n")
    return "\n".join(parts) + numbers(f"{title}: numbers", table([axis, counted], rows))
