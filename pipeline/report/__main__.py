"""Command of the report: one offline page, its figures, the data card, the summary, and a table of all pairs."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from pipeline.records import paths
from pipeline.records.parameters import Parameters, read_parameters, require_allegro
from pipeline.records.writing import whole_file, whole_folder, write_json
from pipeline.stages.running import run_stage
from pipeline.stages.versions import installed_versions

if TYPE_CHECKING:
    from pipeline.report.counting import Counts
    from pipeline.report.dataset_card import CardContent
    from pipeline.report.page import PageContent


def work() -> None:
    """Read every table, count, draw, and write the page, the figures, the card, the summary and the pairs."""
    parameters = read_parameters()
    require_allegro(parameters)
    from plotly.offline import get_plotlyjs

    from pipeline.records.tables import write_table
    from pipeline.report.counting import count_all
    from pipeline.report.dataset_card import dataset_card
    from pipeline.report.learned import load_quality
    from pipeline.report.page import build_page
    from pipeline.report.pairs_table import PAIRS, pairs_table

    partners = parameters.partners()
    reconstructed = {first: tuple(item.side) for first, item in parameters.reconstructed.items()}
    counts = count_all(parameters.styles, partners, reconstructed, parameters.compute.workers)
    quality = {"learned": load_quality("learned", partners)}
    if reconstructed:
        quality[paths.RECONSTRUCTED] = load_quality(paths.RECONSTRUCTED, reconstructed)
    content = page_content(parameters, counts, quality["learned"])
    card = dataset_card(card_content(parameters, counts))
    page = build_page(content, get_plotlyjs())
    write_figures(content)
    with whole_file(paths.REPORT_PAGE) as temporary:
        temporary.write_text(page, encoding="utf-8")
    with whole_file(paths.DATASET_CARD) as temporary:
        temporary.write_text(card, encoding="utf-8")
    write_table(paths.PAIRS_TABLE, pairs_table(counts.pairs, quality), PAIRS)
    write_json(paths.SUMMARY_FILE, dict(content.summary))


def page_content(parameters: Parameters, counts: Counts, quality: Any) -> PageContent:
    """Read what the page shows besides counts, draw it, and return all of it.

    Args:
        quality: figures on the samples of the learned model, per pair.

    Raises:
        UserError: a file is missing or damaged.
    """
    from pipeline.report.drawing import all_shapes, draw_pairs, opening_view
    from pipeline.report.harder import PREFIX, load_harder
    from pipeline.report.learned import load_learned
    from pipeline.report.page import PageContent
    from pipeline.report.reconstructed import load_reconstructed
    from pipeline.report.scene import UNIT
    from pipeline.report.selection import plan
    from pipeline.report.settings import all_settings
    from pipeline.report.summary import summarize
    from pipeline.report.trial_rows import trials_table

    evaluate = parameters.evaluate
    learned = load_learned(quality, counts.samples)
    reconstructed = load_reconstructed(parameters.captures)
    harder = load_harder(parameters.harder, evaluate, parameters.physics)
    planned = plan(counts.trials, harder, parameters.report, evaluate)
    opening = [planned.opening] if planned.opening else []
    drawn = draw_pairs([*planned.shown, *planned.told, *opening], parameters.compute.workers)
    shown = drawn[: len(planned.shown)]
    tables = {
        (source, one.view.first, one.view.second): rows for one in drawn for source, rows in one.tables.items()
    } | {
        (PREFIX + setting.name, *pair): trials_table(PREFIX + setting.name, *pair, setting.rows)
        for setting in harder
        for pair in setting.shown
    }
    metrics = {name: one.metrics for name, one in reconstructed.items()}
    return PageContent(
        summary=summarize(parameters.scale, counts.funnels, counts.merges, counts.trials, metrics, learned, harder),
        funnels=counts.funnels,
        merges=counts.merges,
        trials=counts.trials,
        views=[one.view for one in shown],
        trial_tables=tables,
        shapes=all_shapes(shown),
        shape_unit=UNIT,
        success_height=evaluate.success_height,
        hold_seconds=evaluate.hold_seconds,
        hand_torque_limit=parameters.physics.hand_torque_limit,
        versions=installed_versions(),
        settings=all_settings(parameters),
        drift_limit=parameters.validate_.drift_limit,
        opening=opening_view([*shown, *drawn[len(drawn) - len(opening) :]]),
        counts=counts.pairs,
        worst=planned.worst,
        learned=learned,
        reconstructed=reconstructed,
        harder=harder,
    )


def card_content(parameters: Parameters, counts: Counts) -> CardContent:
    """Read what the data card says besides counts, and return all of it.

    Raises:
        UserError: a file is missing or damaged.
    """
    from pipeline.records.tables import MERGED
    from pipeline.report.dataset_card import CardContent
    from pipeline.report.diversity import diversity, read_validated
    from pipeline.report.objects import read_facts
    from pipeline.report.pairs_table import uses
    from pipeline.report.rates import MOST_PAIRS
    from pipeline.report.settings import all_settings

    few = len(counts.merges) <= MOST_PAIRS
    used, pairs = diversity(counts.synthesized, read_validated(counts.singles)) if few else ([], [])
    return CardContent(
        scale=parameters.scale,
        seed=parameters.seed,
        funnels=counts.funnels,
        merges=counts.merges,
        used=used,
        diversity=pairs,
        uses=[uses(one) for one in counts.synthesized],
        distinct_distance=parameters.merge.distinct_distance,
        objects=[
            read_facts(name) for name in sorted({name for one in counts.merges for name in (one.first, one.second)})
        ],
        columns=MERGED,
        versions=installed_versions(),
        settings=all_settings(parameters),
    )


def write_figures(content: PageContent) -> None:
    """Write the pictures of the page as files.

    Raises:
        UserError: the folder cannot be written to.
    """
    from pipeline.report.figure_files import success_picture

    with whole_folder(paths.FIGURES_FOLDER) as folder:
        for source, pairs in content.trials.items():
            (folder / f"success-{source}.png").write_bytes(success_picture(pairs))
        for view in [*content.views, *([content.opening] if content.opening else [])]:
            for strip in view.strips:
                kind = "failure" if strip.failed else "success"
                (folder / f"{view.name}-{strip.source}-{kind}.jpg").write_bytes(strip.sheet)


def main() -> int:
    """Parse the command line and run the stage."""
    argparse.ArgumentParser(prog="python -m pipeline.report", description=__doc__).parse_args()
    return run_stage("report", work)


if __name__ == "__main__":
    raise SystemExit(main())
