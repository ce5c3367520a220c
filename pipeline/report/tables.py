"""All tables of a run, read by the names in ``params.yaml`` and never by what lies in a folder."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import pandas as pd

from pipeline.records import paths
from pipeline.records.parameters.objects import StylesParameters
from pipeline.records.tables import CANDIDATES, MERGED, TRIALS, VALIDATED, read_table

STYLES = ("pinch", "side")


@dataclass(frozen=True)
class Tables:
    """Every table of a run; keys are (style, object), (first, second) and (source, first)."""

    candidates: dict[tuple[str, str], pd.DataFrame]
    validated: dict[tuple[str, str], pd.DataFrame]
    merged: dict[tuple[str, str], pd.DataFrame]
    trials: dict[tuple[str, str], pd.DataFrame]


def load_tables(styles: StylesParameters, reconstructed: Iterable[str]) -> Tables:
    """Read the tables of all objects and pairs of ``styles``, and the trials of the ``reconstructed`` first objects.

    Raises:
        UserError: a table is missing or damaged.
    """
    firsts_of = dict.fromkeys(paths.SOURCES, styles.pinch) | {paths.RECONSTRUCTED: list(reconstructed)}
    singles = [(style, name) for style in STYLES for name in getattr(styles, style)]
    return Tables(
        candidates={
            (style, name): read_table(paths.candidates_file(style, name), CANDIDATES, f"synthesize-{style}@{name}")
            for style, name in singles
        },
        validated={
            (style, name): read_table(paths.validated_file(style, name), VALIDATED, f"validate-{style}@{name}")
            for style, name in singles
        },
        merged={
            (first, second): read_table(paths.merged_file(first, second), MERGED, f"merge@{first}")
            for first in styles.pinch
            for second in styles.side
        },
        trials={
            (source, first): read_table(paths.trials_file(source, first), TRIALS, f"evaluate-{source}@{first}")
            for source, firsts in firsts_of.items()
            for first in firsts
        },
    )
