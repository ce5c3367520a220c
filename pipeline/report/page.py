"""The report as one HTML text: everything inside, nothing fetched, the same bytes for the same results."""

from __future__ import annotations

from dataclasses import dataclass

from markupsafe import Markup

from pipeline.report.charts import Table
from pipeline.report.conditions import conditions_section
from pipeline.report.content import PageContent
from pipeline.report.embedding import FoldedTable, compressed, compressed_tables
from pipeline.report.headline import headline
from pipeline.report.learned import learned_section
from pipeline.report.merging import merge_section
from pipeline.report.pair_views import pairs_section
from pipeline.report.reconstructed import reconstructed_section
from pipeline.report.rendering import render
from pipeline.report.scene import GRASP_HEADERS
from pipeline.report.settings import settings_section
from pipeline.report.singles import single_section, single_tables
from pipeline.report.success import object_tables, success_section
from pipeline.report.wording import SOURCE_TITLES, trials_key


@dataclass(frozen=True)
class Section:
    """One part of the page."""

    key: str  # id of its element
    title: str
    html: Markup


def build_page(content: PageContent, plotly_source: str) -> str:
    """Return the whole page. Scenes and long tables lie in it compressed and are read when they are wanted.

    Args:
        plotly_source: text of plotly.min.js, embedded once and run only when an interactive view is seen.
    """
    scenes = {view.name: view.grasps for view in content.views if view.grasps}
    return render(
        "page.html",
        header=headline(content.film, content.opening, content.trials, content.summary),
        sections=sections(content),
        blocks={
            "plotly-source": compressed(plotly_source),
            "scene-data": compressed({"unit": content.shape_unit, "shapes": content.shapes, "pairs": scenes}),
            "table-data": compressed_tables(folded_tables(content)),
        },
    )


def folded_tables(content: PageContent) -> dict[str, FoldedTable]:
    """Return, by id, the tables that are made when somebody opens them."""
    return {
        **{trials_key(*key): rows for key, rows in content.trial_tables.items()},
        **{view.grasps_key: FoldedTable(GRASP_HEADERS, view.rows) for view in content.views},
        **object_tables(content.trials),
        **single_tables(content.funnels),
    }


def sections(content: PageContent) -> list[Section]:
    """Return the parts of the page in their order; what a run did not make has none."""
    found = [Section("done", "What was done", _done(content))]
    for source, pairs in content.trials.items():
        html = success_section(source, pairs, content.summary, content.criterion)
        found.append(Section(f"success-{source}", f"Success: {SOURCE_TITLES[source]}", html))
    if content.conditions.tried:
        html = conditions_section(content.conditions, content.criterion, content.hand_torque_limit)
        found.append(Section("conditions", "Other conditions", html))
    if content.learned:
        found.append(Section("learned", "The learned model", learned_section(content.learned)))
    if content.reconstructed:
        found.append(Section("photos", "Objects from photos", reconstructed_section(content.reconstructed)))
    shown = f"The {len(content.worst)} pairs that fare worst" if content.worst else "Every pair"
    pairs_html = pairs_section(content.views, content.trial_tables, content.worst, content.trials)
    return [
        *found,
        Section("pairs", f"{shown}: grasps and trials", pairs_html),
        Section("single", "Single grasps", single_section(content.funnels)),
        Section("merge", "Merging", merge_section(content.merges, content.counts, content.drift_limit)),
        Section("settings", "Settings", settings_section(content.settings)),
        Section("versions", "Versions and durations", _versions(content)),
    ]


def _done(content: PageContent) -> Markup:
    height, seconds = f"{100 * content.success_height:g}", f"{content.hold_seconds:g}"
    return render("done.html", height=height, seconds=seconds)


def _versions(content: PageContent) -> Markup:
    rows = sorted(content.versions.items())
    return render("versions.html", versions=Table(["package", "version"], rows))
