"""Which trials are shown as strips of pictures, and which moments of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pandas as pd


@dataclass(frozen=True)
class ChosenTrials:
    """The trials of one pair to show; None where there is no such trial."""

    success: dict[str, Any] | None
    failure: dict[str, Any] | None


def choose_trials(first: str, second: str, trials: pd.DataFrame) -> ChosenTrials:
    """Return the first successful trial and the first trial that failed for the pair's most common reason."""
    own = trials[(trials["object0"] == first) & (trials["object1"] == second)].sort_values("trial")
    has_pictures = own["snapshot_phases"].map(lambda phases: phases is not None and len(phases) > 0)
    good = own[own["success"].astype(bool) & has_pictures]
    bad = own[~own["success"].astype(bool) & has_pictures]
    if len(bad):
        counts = bad["reason"].value_counts()
        commonest = min(counts[counts == counts.max()].index)
        bad = bad[bad["reason"] == commonest]
    return ChosenTrials(success=_first(good), failure=_first(bad))


def _first(trials: pd.DataFrame) -> dict[str, Any] | None:
    return None if trials.empty else {str(key): value for key, value in trials.iloc[0].items()}


def chosen_moments(phases: list[str], most: int) -> list[int]:
    """Return which snapshots to draw: all, or ``most`` of them spread evenly with the first and the last."""
    count = len(phases)
    if count <= most:
        return list(range(count))
    return sorted({round(index * (count - 1) / (most - 1)) for index in range(most)})
