"""Everything that the page shows, read and drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pipeline.hand.model import Hand
from pipeline.records.opening_film import FOLDER, OpeningFilm, load_film
from pipeline.records.parameters import Parameters
from pipeline.report.conditions import Conditions, Tried, load_conditions
from pipeline.report.counting import Counts, PairCounts
from pipeline.report.drawing import all_shapes, draw_pairs, opening_view
from pipeline.report.embedding import FoldedTable
from pipeline.report.learned import Learned, load_learned
from pipeline.report.pair_views import PairView
from pipeline.report.rates import Funnel, PairMerge, PairTrials
from pipeline.report.reconstructed import Reconstructed, load_reconstructed
from pipeline.report.scene import UNIT
from pipeline.report.selection import plan
from pipeline.report.settings import Row, all_settings
from pipeline.report.summary import Value, summarize
from pipeline.report.trial_rows import trials_table
from pipeline.report.worst import WorstPair
from pipeline.stages.versions import installed_versions


@dataclass(frozen=True)
class PageContent:
    """Everything that the page shows."""

    summary: Mapping[str, Value]
    funnels: Sequence[Funnel]
    merges: Sequence[PairMerge]
    trials: Mapping[str, list[PairTrials]]  # per source
    views: Sequence[PairView]
    trial_tables: Mapping[tuple[str, str, str], FoldedTable]  # per source or series, and pair
    shapes: Mapping[str, dict[str, list[int]]]  # see scene.shape_record
    shape_unit: float  # m
    success_height: float  # m
    hold_seconds: float
    hand_torque_limit: float  # N m
    versions: Mapping[str, str]
    settings: Mapping[str, Sequence[Row]]  # per section of params.yaml
    drift_limit: float  # m, largest motion in the hand that merging lets pass
    film: OpeningFilm | None = None
    opening: PairView | None = None  # pictures of the filmed trial
    counts: Sequence[PairCounts] = ()  # of all pairs and sources
    worst: Sequence[WorstPair] = ()  # the pairs that ``views`` show, where there are too many to show all
    learned: Learned | None = None
    reconstructed: Mapping[str, Reconstructed] = field(default_factory=dict)  # per capture
    conditions: Conditions = Conditions()

    @property
    def criterion(self) -> str:
        """The paper's rule of success in short."""
        return f"{100 * self.success_height:g} cm, {self.hold_seconds:g} s"


def page_content(
    parameters: Parameters, hand: Hand, counts: Counts, quality: Mapping[tuple[str, str], Mapping[str, Any]]
) -> PageContent:
    """Read what the page shows besides counts, draw it, and return all of it.

    Args:
        quality: figures on the samples of the learned model, per pair.

    Raises:
        UserError: a file is missing or damaged.
    """
    evaluate = parameters.evaluate
    learned = load_learned(quality, counts.samples)
    reconstructed = load_reconstructed(parameters.captures)
    conditions = load_conditions(parameters)
    film = load_film(FOLDER)
    planned = plan(counts.trials, conditions.tried, parameters.report, evaluate, film)
    opening = [planned.opening] if planned.opening else []
    drawn = draw_pairs([*planned.shown, *planned.listed, *opening], hand, parameters.compute.workers)
    shown = drawn[: len(planned.shown)]
    tables = {(source, one.view.first, one.view.second): rows for one in drawn for source, rows in one.tables.items()}
    metrics = {name: one.metrics for name, one in reconstructed.items()}
    return PageContent(
        summary=summarize(
            parameters.scale, counts.funnels, counts.merges, counts.trials, metrics, learned, conditions.tried
        ),
        funnels=counts.funnels,
        merges=counts.merges,
        trials=counts.trials,
        views=[one.view for one in shown],
        trial_tables=tables | series_tables(conditions.tried),
        shapes=all_shapes(shown, hand),
        shape_unit=UNIT,
        success_height=evaluate.success_height,
        hold_seconds=evaluate.hold_seconds,
        hand_torque_limit=parameters.physics.hand_torque_limit,
        versions=installed_versions(),
        settings=all_settings(parameters),
        drift_limit=parameters.validate_.drift_limit,
        film=film,
        opening=opening_view([*shown, *drawn[len(drawn) - len(opening) :]], film),
        counts=counts.pairs,
        worst=planned.worst,
        learned=learned,
        reconstructed=reconstructed,
        conditions=conditions,
    )


def series_tables(tried: Sequence[Tried]) -> dict[tuple[str, str, str], FoldedTable]:
    """Return the trials of all series but the standard ones, per series and pair that the page shows."""
    return {
        (one.key, *pair): trials_table(one.key, *pair, one.rows)
        for one in tried
        if not one.is_standard
        for pair in one.shown
    }
