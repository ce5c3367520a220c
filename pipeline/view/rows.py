"""Which rows are shown: filters with counts, colours of reject reasons, and rows by their names.

Tables in, tables out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from pipeline.records.errors import UserError
from pipeline.records.series import series_of
from pipeline.records.sources import SOURCES
from pipeline.view.tables import PREFIXES

# Columns of an index: one line per row of all tables of a view.
# The reason is the reject reason, or why a trial failed; PASSED or SUCCESS where there is none.
INDEX = ("name", "table", "position", "number", "source", "style", "first", "second", "reason", "outcome")
FILTERS = ("source", "style", "first", "second", "reason", "outcome")
ANY = ""  # a filter that lets everything through
PASSED, REJECTED, SUCCESS, FAILURE = "passed", "rejected", "success", "failure"
FOUND, NO_REASON = (0.16, 0.58, 0.44), (0.45, 0.55, 0.70)
# Of reject reasons and reasons of failure, in alphabetical order (Okabe and Ito's colours, and darker ones of them).
FAILED = (
    (0.84, 0.37, 0.00),
    (0.34, 0.71, 0.91),
    (0.80, 0.47, 0.65),
    (0.90, 0.62, 0.00),
    (0.00, 0.45, 0.70),
    (0.55, 0.24, 0.00),
    (0.50, 0.27, 0.55),
    (0.45, 0.45, 0.45),
)
EXAMPLE = "merge/cube/soup_can/3"

Colour = tuple[float, float, float]  # sRGB, 0 to 1


def selected(index: pd.DataFrame, filters: Mapping[str, str]) -> pd.DataFrame:
    """Return the lines of an index that pass all filters (column to value; ``ANY`` lets all through)."""
    keep = pd.Series(True, index=index.index)
    for column, value in filters.items():
        if value != ANY:
            keep &= index[column] == value
    return index[keep]


def choices(index: pd.DataFrame, filters: Mapping[str, str], column: str) -> dict[str, int]:
    """Return the values that ``column`` has, with how many rows each would leave together with the other filters.

    A value that is chosen is always there, if need be with 0 rows.
    """
    others = {name: value for name, value in filters.items() if name != column}
    counts = selected(index, others)[column].value_counts()
    found = {str(value): int(counts[value]) for value in sorted(counts.index) if value != ANY}
    chosen = filters.get(column, ANY)
    if chosen != ANY:
        found.setdefault(chosen, 0)
    return found


def reason_colours(reasons: Sequence[str]) -> dict[str, Colour]:
    """Return a colour per reason, ``PASSED`` and ``SUCCESS`` among them; the same set gives the same colours."""
    colours: dict[str, Colour] = {PASSED: FOUND, SUCCESS: FOUND}
    failed = sorted(set(reasons) - set(colours) - {""})
    colours |= {reason: FAILED[place % len(FAILED)] for place, reason in enumerate(failed)}
    return {reason: colours.get(reason, NO_REASON) for reason in dict.fromkeys(reasons)}


def counted(index: pd.DataFrame) -> dict[str, int]:
    """Return how many rows share each reason, those without one first, then the most frequent."""
    counts = index["reason"].value_counts()
    order = sorted(counts.index, key=lambda reason: (reason not in (PASSED, SUCCESS), -counts[reason], reason))
    return {str(reason): int(counts[reason]) for reason in order}


def page_of(count: int, place: int, size: int) -> tuple[int, int]:
    """Return begin and end of the page with row ``place``, of ``count`` rows on pages of ``size``."""
    begin = place // size * size
    return begin, min(begin + size, count)


def tidy_name(text: str) -> str:
    """Return the name of a row as the index writes it.

    Also accepted: names of trials as the report and `./dev replay` write them (``synthesized/cube/soup_can/3``), and
    paths of tables (``data/merge/cube.parquet``).
    """
    parts = text.strip().strip("/").removeprefix("data/").removesuffix(".parquet").split("/")
    if series_of(parts[0]):
        parts.insert(0, "conditions")
    if parts[0] in (*SOURCES, "conditions"):
        parts.insert(0, "evaluate")
    if parts[0] == "reconstruct" and parts[2:3] == ["objects"]:
        del parts[2]
    return "/".join(parts)


def view_of(name: str) -> str:
    """Return the view that holds a (tidy) name.

    Raises:
        UserError: no view does.
    """
    first = name.split("/")[0]
    if first not in PREFIXES:
        raise UserError(f"{name!r} names no row; names begin with {', '.join(PREFIXES)}, such as {EXAMPLE}.")
    return PREFIXES[first]


def find(index: pd.DataFrame, name: str) -> str:
    """Return the name of the row, or of the first row of the table, that a (tidy) name means.

    Raises:
        UserError: there is none.
    """
    names = index["name"]
    if (names == name).any():
        return name
    beginning = index[names.str.startswith(name + "/")]
    if not beginning.empty:
        return str(beginning.iloc[0]["name"])
    table = name.rpartition("/")[0]
    near = names[names.str.startswith(table + "/")] if table.count("/") else names
    known = f"{near.iloc[0]} to {near.iloc[-1]}" if len(near) else "none yet"
    raise UserError(f"there is no row {name!r}; there are {known}.")
