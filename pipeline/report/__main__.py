"""Command of the report: one offline page, its figures, the data card, the summary, and a table of all pairs."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.records import paths
from pipeline.records.parameters import read_parameters, require_picks
from pipeline.records.writing import whole_file, whole_folder, write_json
from pipeline.stages.running import run_stage

if TYPE_CHECKING:
    from pipeline.report.content import PageContent


def work() -> None:
    """Read every table, count, draw, and write the page, the figures, the card, the summary and the pairs."""
    parameters = read_parameters().with_assets()
    require_picks(parameters)
    from pipeline.hand.model import load_hand
    from pipeline.hand.robot import require_arm

    hand = load_hand(parameters.hand)
    require_arm(hand)
    from plotly.offline import get_plotlyjs

    from pipeline.records.tables import write_table
    from pipeline.report.content import page_content
    from pipeline.report.counting import count_all
    from pipeline.report.dataset_card import card_content, dataset_card
    from pipeline.report.learned import load_quality
    from pipeline.report.page import build_page
    from pipeline.report.pairs_table import PAIRS, pairs_table

    partners = {first: seconds for first, seconds in parameters.partners().items() if seconds}
    tried = parameters.tried_partners()
    reconstructed = {first: tuple(item.side) for first, item in parameters.reconstructed.items()}
    counts = count_all(parameters.styles, partners, reconstructed, parameters.compute.workers, partners.keys() - tried)
    quality = {"learned": load_quality("learned", tried)}
    if reconstructed:
        quality[paths.RECONSTRUCTED] = load_quality(paths.RECONSTRUCTED, reconstructed)
    content = page_content(parameters, hand, counts, quality["learned"])
    card = dataset_card(card_content(parameters, hand, counts))
    page = build_page(content, get_plotlyjs())
    write_figures(content)
    write_text(paths.REPORT_PAGE, page)
    write_text(paths.DATASET_CARD, card)
    write_table(paths.PAIRS_TABLE, pairs_table(counts.pairs, quality), PAIRS)
    write_json(paths.SUMMARY_FILE, dict(content.summary))


def write_text(target: Path, text: str) -> None:
    """Write a text, whole or not at all.

    Raises:
        UserError: the file cannot be written.
    """
    with whole_file(target) as temporary:
        temporary.write_text(text, encoding="utf-8")


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
