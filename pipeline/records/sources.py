"""Where two-object grasps come from. A new source is an entry here and a stage in ``dvc.yaml``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from pipeline.records import paths


@dataclass(frozen=True)
class Source:
    """Tables of grasps with the columns ``records.tables.MERGED``, one for each first object."""

    name: str  # of its trials, as in evaluate@<name>
    title: str  # of its grasps
    origin: str  # how its grasps come about
    stage: str  # of dvc.yaml, which makes its tables
    table: Callable[[str], Path]  # from the first object to the file
    of_all_pairs: bool = True  # otherwise of the pairs under `reconstructed` in params.yaml, in frames of photos
    of_single_grasps: bool = False  # whose rows are those of `validate`, which know the contacts
    abbreviation: str = ""  # of its grasps in published tables, which are about all pairs

    @property
    def folder(self) -> Path:
        """Folder of its tables."""
        return self.table("").parent


SOURCES = {
    source.name: source
    for source in (
        Source(
            name=paths.SYNTHESIZED,
            title="synthesized grasps",
            origin="merged from two single grasps",
            stage="merge",
            table=paths.merged_file,
            of_single_grasps=True,
            abbreviation="SG",
        ),
        Source(
            name=paths.LEARNED,
            title="grasps of the learned model",
            origin="drawn from the model, then refined",
            stage="sample@learned",
            table=partial(paths.sampled_file, paths.LEARNED),
            abbreviation="LG",
        ),
        Source(
            name=paths.RECONSTRUCTED,
            title="grasps of the learned model for reconstructed objects",
            origin="drawn from the model for objects as photos show them",
            stage="sample@reconstructed",
            table=partial(paths.sampled_file, paths.RECONSTRUCTED),
            of_all_pairs=False,
        ),
    )
}
OF_ALL_PAIRS = {name: source for name, source in SOURCES.items() if source.of_all_pairs}
