"""Which tables and folders there are to look at, by params.yaml, and the stage that makes each.

A row is named by where it lies under ``data/``: ``validate/pinch/cube/17`` is the grasp 17 of
``data/validate/pinch/cube.parquet``. Tables of two-object grasps and of trials hold several pairs, so the second object
stands before the number, and the first one too where it differs.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa

from pipeline.hand.model import Hand
from pipeline.records import paths
from pipeline.records.flat import PAIR_GRASPS, PAIR_TRIALS
from pipeline.records.parameters import Parameters
from pipeline.records.parameters.conditions import overridden
from pipeline.records.series import STAGE, series_of
from pipeline.records.sources import SOURCES
from pipeline.records.tables import CANDIDATES, VALIDATED, of_hand

OBJECTS, CANDIDATES_VIEW, VALIDATED_VIEW = "objects", "candidates", "validated grasps"
MERGED_VIEW, TRIALS_VIEW, RECONSTRUCTIONS = "merged grasps", "robot trials", "reconstructions"
VIEWS = (OBJECTS, CANDIDATES_VIEW, VALIDATED_VIEW, MERGED_VIEW, TRIALS_VIEW, RECONSTRUCTIONS)
# The first parts of the names of a view's rows.
PREFIXES = {
    "prepare": OBJECTS,
    "synthesize": CANDIDATES_VIEW,
    "validate": VALIDATED_VIEW,
    **{source.folder.parts[1]: MERGED_VIEW for source in SOURCES.values()},
    "evaluate": TRIALS_VIEW,
    "reconstruct": RECONSTRUCTIONS,
}


@dataclass(frozen=True)
class Table:
    """One parquet file, or one folder that holds a single thing (then ``schema`` is None)."""

    view: str
    file: Path
    stage: str  # DVC stage that makes it
    schema: pa.Schema | None = None
    number: str = ""  # column with the numbers of rows
    source: str = ""  # of grasps and trials: who made them; of reconstructions: the capture
    style: str = ""
    first: str = ""  # the object, or the first of the pair

    @property
    def name(self) -> str:
        """How the names of its rows begin, such as ``validate/pinch/cube``."""
        if self.view == RECONSTRUCTIONS:
            return f"reconstruct/{self.source}/{self.first}"
        return "/".join(self.file.with_suffix("").parts[1:])


def known_tables(parameters: Parameters, hand: Hand) -> list[Table]:
    """Return everything that the pipeline makes with these parameters, whether it is there yet or not."""
    return [
        *_objects(parameters),
        *_grasps(parameters, hand),
        *_pairs(parameters),
        *_trials(parameters),
        *_photos(parameters),
    ]


def _objects(parameters: Parameters) -> list[Table]:
    names = sorted({*parameters.objects, *parameters.meshes, *parameters.styles.pinch, *parameters.styles.side})
    return [Table(OBJECTS, paths.prepared_folder(name), "prepare", first=name) for name in names]


def _grasps(parameters: Parameters, hand: Hand) -> list[Table]:
    styles = {"pinch": parameters.styles.pinch, "side": parameters.styles.side}
    return [
        Table(view, file_of(style, name), f"{stage}@{style}", schema, "grasp_id", style=style, first=name)
        for view, file_of, stage, schema in (
            (CANDIDATES_VIEW, paths.candidates_file, "synthesize", of_hand(CANDIDATES, hand.name, hand.joint_count)),
            (VALIDATED_VIEW, paths.validated_file, "validate", of_hand(VALIDATED, hand.name, hand.joint_count)),
        )
        for style, names in styles.items()
        for name in names
    ]


def _tried(parameters: Parameters) -> dict[str, list[str]]:
    """The first objects of all pairs that the robot tries, by source."""
    firsts, reconstructed = list(parameters.tried_partners()), list(parameters.reconstructed)
    return {name: firsts if source.of_all_pairs else reconstructed for name, source in SOURCES.items()}


def _pairs(parameters: Parameters) -> list[Table]:
    merged = {paths.SYNTHESIZED: [first for first, seconds in parameters.partners().items() if seconds]}
    return [
        Table(
            MERGED_VIEW,
            SOURCES[source].table(first),
            SOURCES[source].stage,
            PAIR_GRASPS,
            "merged_id",
            source,
            first=first,
        )
        for source, names in (_tried(parameters) | merged).items()
        for first in names
    ]


def _trials(parameters: Parameters) -> list[Table]:
    standard = [
        Table(
            TRIALS_VIEW,
            paths.trials_file(source, first),
            f"evaluate@{source}",
            PAIR_TRIALS,
            "trial",
            source,
            first=first,
        )
        for source, names in _tried(parameters).items()
        for first in names
    ]
    to_run = parameters.conditions.to_run(bool(parameters.reconstructed), parameters.evaluate, parameters.physics)
    series = [Table(TRIALS_VIEW, one.table, STAGE, PAIR_TRIALS, "trial", name) for name, one in to_run.items()]
    return standard + series


def _photos(parameters: Parameters) -> list[Table]:
    return [
        Table(
            RECONSTRUCTIONS,
            paths.reconstruction_folder(capture) / "objects" / name,
            "reconstruct",
            source=capture,
            first=name,
        )
        for capture in parameters.captures
        for name in _photographed(parameters, capture)
    ]


def _photographed(parameters: Parameters, capture: str) -> list[str]:
    """Objects of a capture: as it is rendered, or, of real photos, as far as they have been reconstructed."""
    if capture in parameters.renderings:
        return sorted(parameters.renderings[capture].objects)
    return sorted(path.name for path in (paths.reconstruction_folder(capture) / "objects").glob("*"))


def sponge_height(parameters: Parameters, source: str) -> float:
    """Return the height of the sponge, m, on which the objects of a source's trials stand."""
    series = series_of(source)
    if series is None:
        return parameters.evaluate.sponge_height
    return overridden(parameters.evaluate, parameters.conditions.settings[series.condition].evaluate).sponge_height
