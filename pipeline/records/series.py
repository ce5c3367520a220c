"""Series of robot trials under one condition: their names, and the tables that hold them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pipeline.records import paths
from pipeline.records.sources import SOURCES

STAGE = "evaluate-conditions"


@dataclass(frozen=True, order=True)
class TrialSeries:
    """Trials with the grasps of one source under one condition in one physics engine."""

    source: str
    condition: str
    engine: str

    def __str__(self) -> str:
        """Return its name, such as ``learned-mu_0_5-sapien``, in the place of a source in the names of trials."""
        return f"{self.source}-{self.condition}-{self.engine}"

    @property
    def table(self) -> Path:
        """The file with its trials."""
        return paths.series_file(str(self))


def series_of(name: str) -> TrialSeries | None:
    """Return the series with a name, or None for other names, such as that of a source alone."""
    parts = name.split("-")
    return TrialSeries(*parts) if len(parts) == 3 and parts[0] in SOURCES else None
