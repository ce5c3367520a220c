"""Published comparisons: small tables that a script of ``benchmarks/`` made once, kept in git and shown in the report.

A file begins with lines `# name: value` on how it was made, then the table as CSV; without rows, nothing has been
published. They are no results of the run that the report shows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from pipeline.records.errors import UserError
from pipeline.records.writing import whole_file
from pipeline.report.charts import Table
from pipeline.report.wording import UNKNOWN, percent

OBJECTIVES_FILE = Path("reports/learned_objectives.csv")
ABLATION_FILE = Path("reports/learned_ablation.csv")

# Column of the file: header in the report, and what its numbers are.
OBJECTIVES = {
    "objective": ("objective", "word"),
    "sampler": ("sampler", "word"),
    "usable": ("usable", "share"),
    "usable_least": ("least seed", "share"),
    "usable_most": ("best seed", "share"),
    "usable_unseen": ("on unseen pairs", "share"),
    "usable_refined": ("usable when refined", "share"),
    "overlap_mm": ("overlap (mm)", "number"),
    "contact_mm": ("contact distance (mm)", "number"),
    "spread_mm": ("between samples (mm)", "number"),
    "sampling_seconds": ("samples of a pair (CPU s)", "number"),
    "usable_per_second": ("usable per CPU s", "number"),
}
ABLATION = {
    "steps": ("from samples to grasps", "word"),
    "grasps": ("grasps of a pair", "number"),
    "penetration_mm": ("penetration (mm)", "number"),
    "contact_mm": ("contact distance (mm)", "number"),
    "objects_overlap": ("objects overlap", "share"),
    "pass_checks": ("pass all checks", "share"),
    "trials": ("trials", "number"),
    "success": ("success", "share"),
    "no_motion": ("no motion found", "share"),
    "seconds": ("CPU s of a pair", "number"),
}


@dataclass(frozen=True)
class Comparison:
    """One published table."""

    facts: Mapping[str, str]  # how it was made: command, data, commit ...
    rows: Sequence[Mapping[str, str | float]]


def write_comparison(target: Path, rows: pd.DataFrame, facts: Mapping[str, str]) -> None:
    """Write a comparison, whole or not at all.

    Raises:
        UserError: the file cannot be written.
    """
    head = "".join(f"# {name}: {' '.join(value.split())}\n" for name, value in facts.items())
    with whole_file(target) as temporary:
        temporary.write_text(head + rows.to_csv(index=False, float_format="%.4g"), encoding="utf-8")


def read_comparison(source: Path, columns: Mapping[str, tuple[str, str]]) -> Comparison | None:
    """Read what :func:`write_comparison` wrote; None where nothing was published.

    Raises:
        UserError: the file is damaged.
    """
    try:
        lines = source.read_text(encoding="utf-8").splitlines()
        heads = [line[2:].partition(": ") for line in lines if line.startswith("# ")]
        rows = pd.read_csv(source, skiprows=len(heads), keep_default_na=True)
        missing = [name for name in columns if name not in rows]
        if missing:
            raise ValueError(f"no column {missing[0]}")
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise UserError(
            f"{source} is damaged ({' '.join(str(error).split())[:80]}); restore it with `git restore {source}`."
        ) from error
    records = [{str(name): value for name, value in row.items()} for row in rows.to_dict("records")]
    return Comparison({name: value for name, _, value in heads}, records)


def comparison_table(comparison: Comparison | None, columns: Mapping[str, tuple[str, str]]) -> Table | None:
    """Return the published rows as the page shows them; None where there are none."""
    if comparison is None or not comparison.rows:
        return None
    rows = [[_cell(row[name], kind) for name, (_, kind) in columns.items()] for row in comparison.rows]
    return Table([header for header, _ in columns.values()], rows)


def _cell(value: str | float, kind: str) -> str:
    if isinstance(value, str):
        return value
    if value != value:
        return UNKNOWN
    return percent(value) if kind == "share" else f"{value:.3g}"
