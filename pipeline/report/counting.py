"""Counts of all tables of a run: only the columns that count are read, so that a large run fits into memory."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.compute.fan_out import fan_out
from pipeline.records import paths
from pipeline.records.flat import PAIR_GRASPS, PAIR_TRIALS, read_flat_columns
from pipeline.records.parameters.objects import StylesParameters
from pipeline.records.sources import SOURCES
from pipeline.records.tables import CANDIDATES, VALIDATED, read_columns
from pipeline.report.rates import (
    MOST_PAIRS,
    OUTCOMES,
    Columns,
    Funnel,
    PairMerge,
    PairTrials,
    pair_merge,
    pair_trials,
    single_grasp_funnel,
)

STYLES = ("pinch", "side")
SYNTHESIZED, LEARNED = paths.SYNTHESIZED, paths.LEARNED
GRASP_COLUMNS = ("object1", "grasp0_id", "grasp1_id", "gravity_drift", "rejected_by")


@dataclass(frozen=True)
class Single:
    """One object in one style."""

    style: str
    object_name: str


@dataclass(frozen=True)
class First:
    """The pairs of one source that begin with one object."""

    source: str
    first: str
    seconds: tuple[str, ...]
    tried: bool = True  # by the robot; otherwise merged for the training alone


@dataclass(frozen=True)
class PairCounts:
    """What became of one pair with the grasps of one source."""

    source: str
    grasps: PairMerge  # combinations or samples that were checked
    trials: PairTrials
    tried: bool
    grasp_ids: NDArray[np.int64]  # (accepted, 2) single grasps of the first and of the second object
    drifts: NDArray[np.float64]  # (accepted,) m, largest motion in the hand under gravity; nan where not tested

    @property
    def first(self) -> str:
        """Object picked first."""
        return self.trials.first

    @property
    def second(self) -> str:
        """Object picked second."""
        return self.trials.second


@dataclass(frozen=True)
class Counts:
    """What became of every object and pair of a run."""

    singles: list[Single]
    funnels: list[Funnel]  # one per entry of ``singles``
    sources: tuple[str, ...]
    pairs: list[PairCounts]  # source by source

    @property
    def synthesized(self) -> list[PairCounts]:
        """Those of synthesized grasps."""
        return [pair for pair in self.pairs if pair.source == SYNTHESIZED]

    @property
    def merges(self) -> list[PairMerge]:
        """Outcomes of combinations of synthesized grasps, per pair."""
        return [pair.grasps for pair in self.synthesized]

    @property
    def samples(self) -> list[PairMerge]:
        """Outcomes of samples of the model, per pair."""
        return [pair.grasps for pair in self.pairs if pair.source == LEARNED]

    @property
    def trials(self) -> dict[str, list[PairTrials]]:
        """Outcomes of trials, per source and pair that the robot tries."""
        tried = [pair for pair in self.pairs if pair.tried]
        return {source: [pair.trials for pair in tried if pair.source == source] for source in self.sources}


def count_all(
    styles: StylesParameters,
    partners: Mapping[str, Sequence[str]],
    reconstructed: Mapping[str, Sequence[str]],
    workers: int,
    only_trained: Collection[str] = (),
) -> Counts:
    """Read and count all tables of a run.

    Args:
        partners: per first object, the objects that are picked after it.
        reconstructed: the same for the pairs of reconstructed objects.
        workers: processes to read many tables with; see ``compute.fan_out``.
        only_trained: first objects of pairs that are merged for the training alone.

    Raises:
        UserError: a table is missing or damaged.
    """
    singles = [Single(style, name) for style in STYLES for name in getattr(styles, style)]
    firsts = firsts_of(partners, reconstructed, only_trained)
    workers = workers if len(singles) + len(firsts) > MOST_PAIRS else 1
    pairs = fan_out(count_first, firsts, workers, "tables of pairs")
    return Counts(
        singles=singles,
        funnels=fan_out(count_single, singles, workers, "tables of single grasps"),
        sources=tuple(name for name, source in SOURCES.items() if source.of_all_pairs or reconstructed),
        pairs=[pair for own in pairs for pair in own],
    )


def firsts_of(
    partners: Mapping[str, Sequence[str]],
    reconstructed: Mapping[str, Sequence[str]],
    only_trained: Collection[str] = (),
) -> list[First]:
    """Return all tables of two-object grasps that a run has: source by source, in the order of the objects.

    Args:
        partners: per first object, the objects that are picked after it.
        reconstructed: the same for the pairs of reconstructed objects.
        only_trained: first objects of pairs that are merged for the training alone.
    """
    pairs = [(name, partners if source.of_all_pairs else reconstructed) for name, source in SOURCES.items()]
    return [
        First(source, first, tuple(seconds), first not in only_trained)
        for source, own in pairs
        for first, seconds in own.items()
        if source == SYNTHESIZED or first not in only_trained
    ]


def grasps_of(source: str, first: str) -> tuple[Path, pa.Schema, str]:
    """Return the table of a source's two-object grasps that begin with ``first``: file, columns, stage."""
    return SOURCES[source].table(first), PAIR_GRASPS, SOURCES[source].stage


def trials_of(source: str, first: str) -> tuple[Path, pa.Schema, str]:
    """Return the table of a source's trials that begin with ``first``: file, columns, stage."""
    return paths.trials_file(source, first), PAIR_TRIALS, f"evaluate@{source}"


def count_single(item: Single) -> Funnel:
    """Read what became of one object's chains.

    Raises:
        UserError: a table is missing or damaged.
    """
    names, chains = (item.style, item.object_name), ["grasp_id", "rejected_by"]
    candidates = read_columns(paths.candidates_file(*names), CANDIDATES, f"synthesize@{item.style}", chains)
    validated = read_columns(
        paths.validated_file(*names), VALIDATED, f"validate@{item.style}", [*chains, "contact_only_pass"]
    )
    return single_grasp_funnel(*names, candidates, validated)


def count_first(item: First) -> list[PairCounts]:
    """Read what became of all pairs of one source that begin with one object.

    Raises:
        UserError: a table is missing or damaged.
    """
    grasps = read_flat_columns(*grasps_of(item.source, item.first), GRASP_COLUMNS)
    trials: Columns = {name: [] for name in OUTCOMES}
    if item.tried:
        trials = read_flat_columns(*trials_of(item.source, item.first), OUTCOMES)
    return [pair_counts(item.source, item.first, second, grasps, trials, item.tried) for second in item.seconds]


def pair_counts(
    source: str, first: str, second: str, grasps: Columns, trials: Columns, tried: bool = True
) -> PairCounts:
    """Count one pair; both tables may hold other pairs with the same first object too."""
    own = [row for row in zip(*(grasps[name] for name in GRASP_COLUMNS), strict=True) if row[0] == second]
    accepted = [row for row in own if row[-1] == ""]
    return PairCounts(
        source=source,
        grasps=pair_merge(first, second, (check for *_, check in own)),
        trials=pair_trials(first, second, trials),
        tried=tried,
        grasp_ids=np.array([row[1:3] for row in accepted], np.int64).reshape(-1, 2),
        drifts=np.array([_largest(drift) for _, _, _, drift, _ in accepted], np.float64),
    )


def _largest(values: Sequence[float] | None) -> float:
    return float("nan") if values is None or not len(values) else float(max(values))
