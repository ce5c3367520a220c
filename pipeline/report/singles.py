"""Single grasps: what became of the chains of every object, beside Table I of the paper."""

from __future__ import annotations

from collections.abc import Sequence

from markupsafe import Markup

from pipeline.report import paper
from pipeline.report.charts import (
    PERCENT_EDGES,
    Counts,
    Histogram,
    Table,
    explanations,
    histogram,
    spread_table,
    stacked_bars,
)
from pipeline.report.embedding import FoldedTable
from pipeline.report.meanings import SYNTHESIS, VALIDATION
from pipeline.report.rates import MOST_PAIRS, Funnel, ratio, spread, summed
from pipeline.report.rendering import render
from pipeline.report.wording import PASSED, UNKNOWN, percent, singles_key, spoken

HEADERS = (
    "object",
    "chains",
    "passed the filter",
    "validated",
    "validated / chains",
    "paper: successes / batch",
    "validated / passed",
    "paper’s contact rule",
)


def single_section(funnels: Sequence[Funnel]) -> Markup:
    """Return rates per object, and what the others were rejected by; of many objects, how the rates are distributed."""
    many = len(funnels) > MOST_PAIRS
    styles = _by_style(funnels)
    groups = styles if many else {f"{spoken(one.object_name)} ({one.style})": [one] for one in funnels}  # of a bar each
    synthesis: list[tuple[str, Counts]] = []
    physics: list[tuple[str, Counts]] = []
    for label, own in groups.items():
        passed, validated = sum(one.passed for one in own), sum(one.validated for one in own)
        synthesis.append((label, {PASSED: passed, **summed(one.synthesize_rejected for one in own)}))
        physics.append((label, {PASSED: validated, **summed(one.validate_rejected for one in own)}))
    first_column, of_what = ("style", "") if many else ("object", " per object")
    return render(
        "singles.html",
        rates=_spreads(styles) if many else Table(HEADERS, [single_row(one) for one in funnels]),
        styles=[(style, _histogram(style, own), singles_key(style), len(own)) for style, own in styles.items()]
        if many
        else [],
        chains=stacked_bars(synthesis, PASSED, f"Outcomes of chains{of_what}", first_column),
        chain_reasons=explanations((check for one in funnels for check in one.synthesize_rejected), SYNTHESIS),
        tested=stacked_bars(physics, PASSED, f"Outcomes of tested grasps{of_what}", first_column),
        tested_reasons=explanations((check for one in funnels for check in one.validate_rejected), VALIDATION),
    )


def _by_style(funnels: Sequence[Funnel]) -> dict[str, list[Funnel]]:
    return {style: [one for one in funnels if one.style == style] for style in dict.fromkeys(f.style for f in funnels)}


def _spreads(styles: dict[str, list[Funnel]]) -> Table:
    rows = []
    for style, own in styles.items():
        rows += [
            (f"validated grasps, {style}", len(own), spread([one.validated for one in own]), 1),
            (f"validated / chains (%), {style}", len(own), spread([100 * one.survival_rate for one in own]), 1),
            (
                f"validated / passed (%), {style}",
                len(own),
                spread([100 * one.survival_rate_of_passed for one in own]),
                1,
            ),
        ]
    return spread_table("of an object", rows)


def _histogram(style: str, funnels: Sequence[Funnel]) -> Histogram:
    rates = [100 * one.survival_rate for one in funnels]
    title, axis = f"Validated / chains, {style}", "validated / chains of an object (%)"
    return histogram(rates, PERCENT_EDGES, title, axis, "objects")


def single_row(funnel: Funnel) -> list[str]:
    """Return the figures of one object in one style under ``HEADERS``."""
    published = paper.SINGLE_GRASP_SUCCESS.get(funnel.style, {}).get(funnel.object_name)
    contact_only = ratio(funnel.contact_only_passed, funnel.contact_only_tested)
    return [
        f"{spoken(funnel.object_name)} ({funnel.style})",
        str(funnel.optimised),
        str(funnel.passed),
        str(funnel.validated),
        percent(funnel.survival_rate),
        percent(published) if published is not None else UNKNOWN,
        percent(funnel.survival_rate_of_passed),
        f"{funnel.contact_only_passed} of {funnel.contact_only_tested} ({percent(contact_only)})",
    ]


def single_tables(funnels: Sequence[Funnel]) -> dict[str, FoldedTable]:
    """Return, by id, the tables of all objects per style, where they are too many to show each."""
    styles = _by_style(funnels) if len(funnels) > MOST_PAIRS else {}
    return {singles_key(style): FoldedTable(HEADERS, [single_row(one) for one in own]) for style, own in styles.items()}
