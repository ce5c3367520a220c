"""What scoring found, as the rows of a table."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from pipeline.records.tables import ROBUSTNESS
from pipeline.score.scoring import Engine, ReadyGrasp, Verdict

HOLDS = "holds"
MARGINS_SHOWN = ("margin_mass_factor", "margin_lowest_friction")  # the same in all engines


def table(
    grasps: Sequence[ReadyGrasp], verdicts: Sequence[Mapping[Engine, Verdict]], excess: Sequence[float]
) -> pd.DataFrame:
    """Return a row per grasp, lengths in millimetres.

    Args:
        excess: rad, how far joints of each grasp were beyond their limits in the file.
    """
    rows = zip(grasps, verdicts, excess, strict=True)
    return pd.DataFrame([_row(index, *each) for index, each in enumerate(rows)])


def _row(number: int, grasp: ReadyGrasp, verdicts: Mapping[Engine, Verdict], excess: float) -> dict[str, Any]:
    failed = [f"{verdict.rejected_by} in {engine}" for engine, verdict in verdicts.items() if verdict.failed]
    distance = max(float(assigned.contacts.distance[0]) for assigned in grasp.assigned)
    row: dict[str, Any] = {
        "grasp": number,
        "objects": " + ".join(prepared.name for prepared in grasp.objects),
        "fingers": "; ".join("+".join(assigned.fingers) for assigned in grasp.assigned),
        "contact_distance_mm": round(1000 * distance, 2),
        "depth_mm": round(1000 * max(assigned.deepest for assigned in grasp.assigned), 2),
        "joint_excess_rad": round(excess, 4),
        "verdict": f"fails {'; '.join(failed)}" if failed else HOLDS,
    }
    for engine, verdict in verdicts.items():
        row[f"{engine}_rejected_by"] = verdict.rejected_by
        row[f"{engine}_failed"] = "; ".join(verdict.failed)
        row[f"{engine}_drift_mm"] = _largest(verdict.columns.get("gravity_drift"))
        row |= {f"{engine}_{column.name}": verdict.columns.get(column.name) for column in ROBUSTNESS}
    passed = [verdict.columns for verdict in verdicts.values() if not verdict.failed]
    return row | {name: _margin(passed, name) for name in MARGINS_SHOWN}


def _largest(values: Any) -> float | None:
    """Return the largest length in millimetres; None where nothing was measured, or physics lost the object."""
    if values is None or not len(values) or not np.isfinite(values).all():
        return None
    return round(1000 * float(np.max(values)), 2)


def _margin(passed: Iterable[Mapping[str, Any]], name: str) -> float | None:
    """Return a margin of the grasp, of the weaker grip where there are two."""
    for columns in passed:
        values = columns[f"{name}s"] if f"{name}s" in columns else [columns.get(name)]
        if any(value is None for value in values):
            return None
        return round(float(max(values) if name.endswith("friction") else min(values)), 4)
    return None
