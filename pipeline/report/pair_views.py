"""What the page shows of single pairs: merged grasps to turn, pictures of trials, and the folded tables of both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from markupsafe import Markup

from pipeline.report.embedding import FoldedTable
from pipeline.report.rates import PairTrials
from pipeline.report.rendering import render
from pipeline.report.wording import SUCCESS, grasps_key, pair_key, pair_title, trials_key, trials_title
from pipeline.report.worst import WorstPair, worst_table


@dataclass(frozen=True)
class Strip:
    """Pictures of one trial."""

    title: str
    captions: list[str]
    pictures: list[bytes]  # WebP
    sheet: bytes = b""  # all of them in their full size, JPEG
    failed: bool = False
    source: str = "synthesized"  # where the grasp came from
    trial: int = 0
    shape: tuple[int, int] = (4, 3)  # width and height of the pictures, in any unit
    replay: str = ""  # the command that runs the trial again


@dataclass(frozen=True)
class PairView:
    """What is shown of one pair besides numbers."""

    first: str
    second: str
    grasps: list[dict[str, Any]]  # see scene.grasp_record
    rows: list[list[str]]  # their numbers, see scene.grasp_row
    poster: bytes | None  # WebP of the first grasp, shown until (and where not) the interactive view is
    strips: list[Strip] = field(default_factory=list)

    @property
    def name(self) -> str:
        """Key of the pair, as in the summary."""
        return f"{self.first}--{self.second}"

    @property
    def key(self) -> str:
        """Id of what is shown of the pair."""
        return pair_key(self.first, self.second)

    @property
    def grasps_key(self) -> str:
        """Id of the table of its grasps."""
        return grasps_key(self.first, self.second)

    @property
    def title(self) -> str:
        """What the pair is called."""
        return pair_title(self.first, self.second)

    def trials_key(self, source: str) -> str:
        """Return the id of the table of its trials with the grasps of a source."""
        return trials_key(source, self.first, self.second)


def pairs_section(
    views: Sequence[PairView],
    tables: Mapping[tuple[str, str, str], FoldedTable],
    worst: Sequence[WorstPair],
    trials: Mapping[str, Sequence[PairTrials]],
) -> Markup:
    """Return, for every pair that is shown, its grasps in 3D, the strips of its trials, and the folded tables of both.

    Args:
        views: the pairs that are shown. The others in ``tables`` get a place for their trials alone.
        tables: trials per source or series, and pair.
        worst: the pairs of ``views`` where there are too many pairs to show all.
        trials: counts per source and pair.
    """
    folds: dict[tuple[str, str], list[tuple[str, str]]] = {(view.first, view.second): [] for view in views}
    for (source, first, second), table in tables.items():
        succeeded = sum(row[1] == SUCCESS for row in table.rows)
        title = f"Trials, {trials_title(source)}: {succeeded} of {len(table.rows)} succeed"
        folds.setdefault((first, second), []).append((trials_key(source, first, second), title))
    shown = {(view.first, view.second): view for view in views}
    bare = [PairView(*pair, grasps=[], rows=[], poster=None) for pair in folds if pair not in shown]
    return render(
        "pairs.html",
        views=[(view, folds[view.first, view.second]) for view in views],
        others=[(view, folds[view.first, view.second]) for view in bare],
        worst=worst_table(worst, trials) if worst else None,
        pairs=max(map(len, trials.values()), default=0),
    )
