"""What is looked at: which view, which of its rows, and how they are arranged. Choices in, choices out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import pandas as pd

from pipeline.records.errors import UserError
from pipeline.view import rows
from pipeline.view.scenes import ON_TOP, ONE, SIDE_BY_SIDE
from pipeline.view.tables import (
    CANDIDATES_VIEW,
    MERGED_VIEW,
    OBJECTS,
    RECONSTRUCTIONS,
    TRIALS_VIEW,
    VALIDATED_VIEW,
)

PAGE_SIZES = {SIDE_BY_SIDE: 48, ON_TOP: 500, ONE: 1}  # rows at once; the arrows lead to the next
ARRANGEMENTS = {
    OBJECTS: (SIDE_BY_SIDE, ONE),
    CANDIDATES_VIEW: (SIDE_BY_SIDE, ONE, ON_TOP),
    VALIDATED_VIEW: (SIDE_BY_SIDE, ONE, ON_TOP),
    MERGED_VIEW: (SIDE_BY_SIDE, ONE, ON_TOP),
    TRIALS_VIEW: (ONE,),
    RECONSTRUCTIONS: (SIDE_BY_SIDE, ONE),
}
LAST = -1  # moment of a trial


def _no_filters() -> dict[str, str]:
    return dict.fromkeys(rows.FILTERS, rows.ANY)


@dataclass(frozen=True)
class Choice:
    """Rows of one view."""

    view: str = OBJECTS
    filters: Mapping[str, str] = field(default_factory=_no_filters)  # per column of an index
    arrangement: str = SIDE_BY_SIDE
    place: int = 0  # of the row among those selected
    moment: int = LAST  # of a trial: which snapshot

    @property
    def page_size(self) -> int:
        """Rows that are shown at once."""
        return PAGE_SIZES[self.arrangement]

    def stepped(self, by: int, count: int) -> Choice:
        """Return the choice of the next page (or the one before), of ``count`` rows; after the last comes the first."""
        pages = -(-max(count, 1) // self.page_size)
        return replace(self, place=(self.place // self.page_size + by) % pages * self.page_size)

    def filtered(self, column: str, value: str) -> Choice:
        """Return the choice of the rows that have ``value`` in ``column``; ``rows.ANY`` lets all through."""
        return replace(self, filters={**self.filters, column: value}, place=0)

    def within(self, count: int) -> Choice:
        """Return the choice with its place among ``count`` rows."""
        return replace(self, place=min(max(self.place, 0), max(count - 1, 0)))


def turned_to(view: str) -> Choice:
    """Return the first choice of a view: all its rows."""
    return Choice(view, arrangement=ARRANGEMENTS[view][0])


def named(text: str, index_of: Callable[[str], tuple[pd.DataFrame, list[str]]]) -> Choice:
    """Return the row that ``text`` names, among those of its table; many rows at once where it names a table.

    Args:
        index_of: index of a view, and a sentence per table that cannot be read; see ``Library.index``.

    Raises:
        UserError: there is no such row.
    """
    name = rows.tidy_name(text)
    view = rows.view_of(name)
    index, sentences = index_of(view)
    if index.empty and sentences:
        raise UserError(sentences[0])
    row = rows.find(index, name)
    line = index[index["name"] == row].iloc[0]
    filters = _no_filters()
    if view not in (OBJECTS, RECONSTRUCTIONS):
        filters |= {column: line[column] for column in ("source", "style", "first", "second")}
    place = rows.selected(index, filters)["name"].tolist().index(row)
    return Choice(view, filters, ONE if row == name else ARRANGEMENTS[view][0], place)
