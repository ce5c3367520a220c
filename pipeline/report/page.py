"""The report as one HTML text: everything inside, nothing fetched, the same bytes for the same results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

from pipeline.records.sources import SOURCES
from pipeline.report import paper
from pipeline.report.charts import (
    MOST_CELLS,
    Cell,
    Link,
    anchor,
    bars_with_table,
    heat_map,
    image,
    matrix,
    numbers,
    percent,
    table,
)
from pipeline.report.chosen_trials import chosen_moments
from pipeline.report.counting import SYNTHESIZED, PairCounts
from pipeline.report.embedding import FoldedTable, compressed_block, fold, tables_block
from pipeline.report.harder import PREFIX, Harder, harder_section
from pipeline.report.learned import Learned, learned_section
from pipeline.report.many import (
    SINGLE_HEADERS,
    WorstPair,
    every_row,
    merges_of_many,
    object_tables,
    single_row,
    single_tables,
    singles_of_many,
    success_of_many,
    worst_table,
)
from pipeline.report.meanings import MERGE, SYNTHESIS, TRIALS, VALIDATION, explained
from pipeline.report.rates import MOST_PAIRS, Funnel, PairMerge, PairTrials, wilson_interval
from pipeline.report.reconstructed import Reconstructed, reconstructed_section
from pipeline.report.scene import GRASP_HEADERS
from pipeline.report.settings import Row
from pipeline.report.summary import Value
from pipeline.report.trial_rows import trials_key

PASSED = "passed"
SUCCESS = "success"
MOST_TILES = 6  # in the first row
OPENING_PICTURES = 6
MOST_SETTINGS = 120  # rows of one section of params.yaml
MOST_LETTERS = 400  # of one value
PAIR_KEY = "pair-"
SOURCE_TITLES = {name: source.title for name, source in SOURCES.items()}


@dataclass(frozen=True)
class Strip:
    """Pictures of one trial."""

    title: str
    captions: list[str]
    pictures: list[bytes]  # WebP
    sheet: bytes = b""  # all of them in their full size, JPEG
    failed: bool = False
    source: str = "synthesized"  # where the grasp came from
    trial: int = 0
    shape: tuple[int, int] = (4, 3)  # width and height of the pictures, in any unit
    replay: str = ""  # the command that runs the trial again


@dataclass(frozen=True)
class PairView:
    """What is shown of one pair besides numbers."""

    first: str
    second: str
    grasps: list[dict[str, Any]]  # see scene.grasp_record
    rows: list[list[str]]  # their numbers, see scene.grasp_row
    poster: bytes | None  # WebP of the first grasp, shown until (and where not) the interactive view is
    strips: list[Strip] = field(default_factory=list)

    @property
    def name(self) -> str:
        """Key of the pair, as in the summary."""
        return f"{self.first}--{self.second}"


@dataclass(frozen=True)
class PageContent:
    """Everything that the page shows."""

    summary: Mapping[str, Value]
    funnels: Sequence[Funnel]
    merges: Sequence[PairMerge]
    trials: Mapping[str, list[PairTrials]]  # per source
    views: Sequence[PairView]
    trial_tables: Mapping[tuple[str, str, str], FoldedTable]  # per source or harder setting, and pair
    shapes: Mapping[str, dict[str, list[int]]]  # see scene.shape_record
    shape_unit: float  # m
    success_height: float  # m
    hold_seconds: float
    hand_torque_limit: float  # N m
    versions: Mapping[str, str]
    settings: Mapping[str, Sequence[Row]]  # per section of params.yaml
    drift_limit: float  # m, largest motion in the hand that merging lets pass
    opening: PairView | None = None  # a pair with one successful trial, which stands on top of the page
    counts: Sequence[PairCounts] = ()  # of all pairs and sources
    worst: Sequence[WorstPair] = ()  # the pairs that ``views`` show, where there are too many to show all
    learned: Learned | None = None
    reconstructed: Mapping[str, Reconstructed] = field(default_factory=dict)  # per capture
    harder: Sequence[Harder] = ()

    @property
    def criterion(self) -> str:
        """The paper's rule of success in short."""
        return f"{100 * self.success_height:g} cm, {self.hold_seconds:g} s"


def _spoken(name: str) -> str:
    return name.replace("_", " ")


def _pair(first: str, second: str) -> str:
    return f"{_spoken(first)} + {_spoken(second)}"


def pair_key(first: str, second: str) -> str:
    """Return the id of what is shown of a pair."""
    return f"{PAIR_KEY}{first}--{second}"


def grasps_key(first: str, second: str) -> str:
    """Return the id of the table of a pair's grasps."""
    return f"grasps-{first}--{second}"


def build_page(content: PageContent, plotly_source: str) -> str:
    """Return the whole page. Scenes and long tables lie in it compressed and are read when they are wanted.

    Args:
        plotly_source: text of plotly.min.js, embedded once and run only when an interactive view is seen.
    """
    here = Path(__file__).parent
    scenes = {view.name: view.grasps for view in content.views if view.grasps}
    scene_data = {"unit": content.shape_unit, "shapes": content.shapes, "pairs": scenes}
    tables = {trials_key(*key): rows for key, rows in content.trial_tables.items()}
    tables |= {grasps_key(view.first, view.second): FoldedTable(GRASP_HEADERS, view.rows) for view in content.views}
    tables |= object_tables({source: own for source, own in content.trials.items() if len(own) > MOST_PAIRS})
    tables |= single_tables(content.funnels) if len(content.funnels) > MOST_PAIRS else {}
    shown = f"The {len(content.worst)} pairs that fare worst" if content.worst else "Every pair"
    sections = [
        ("done", "What was done", done_section(content)),
        *[
            (f"success-{source}", f"Success: {SOURCE_TITLES[source]}", success_section(content, source, pairs))
            for source, pairs in content.trials.items()
        ],
        *(
            [("harder", "Harder settings", harder_section(found, content.criterion, content.hand_torque_limit))]
            if (found := content.harder)
            else []
        ),
        *([("learned", "The learned model", learned_section(content.learned))] if content.learned else []),
        *(
            [("photos", "Objects from photos", reconstructed_section(photographed))]
            if (photographed := content.reconstructed)
            else []
        ),
        ("pairs", f"{shown}: grasps and trials", pairs_section(content)),
        ("single", "Single grasps", single_section(content.funnels)),
        ("merge", "Merging", merge_section(content)),
        ("settings", "Settings", settings_section(content.settings)),
        ("versions", "Versions and durations", versions_section(content.versions)),
    ]
    css = (here / "page.css").read_text()
    contents = "".join(f'<a href="#{key}">{escape(title)}</a>' for key, title, _ in sections)
    body = "".join(f'<section id="{key}"><h2>{escape(title)}</h2>\n{html}</section>\n' for key, title, html in sections)
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>Sequential grasping: report</title>\n<style>\n{css}</style></head>\n<body>\n"
        "<header><h1>One hand, two objects, one after the other</h1>\n"
        f"{opening_strip(content.opening)}{result_sentence(content.trials)}{headline(content)}"
        f"<nav>{contents}</nav></header>\n"
        f"<main>\n{body}</main>\n"
        "<footer><p>Every figure comes from the tables under <code>data/</code>; <code>docs/metrics.md</code> defines "
        "each key of <code>reports/summary.json</code>.</p></footer>\n"
        + compressed_block("plotly-source", plotly_source)
        + compressed_block("scene-data", scene_data)
        + tables_block("table-data", tables)
        + "".join(f"<script>\n{(here / name).read_text()}</script>\n" for name in ("folds.js", "viewer.js"))
        + "</body></html>\n"
    )


def opening_strip(opening: PairView | None) -> str:
    """Return a successful trial in a few pictures, without a number; '' where there is none."""
    if opening is None:
        return ""
    strip = opening.strips[0]
    figures = "".join(
        _figure(strip, moment) for moment in chosen_moments(strip.captions, min(OPENING_PICTURES, len(strip.captions)))
    )
    words = f"A trial of the simulated robot: first the {_spoken(opening.first)}, then the {_spoken(opening.second)}."
    return f'<div class="opening"><div class="strip">{figures}</div><p class="under">{escape(words)}</p></div>\n'


def result_sentence(trials: Mapping[str, Sequence[PairTrials]]) -> str:
    """Return the result in one sentence: the share of all trials that succeed, with its interval."""
    parts = []
    for source, pairs in trials.items():
        tried, successes = sum(pair.trials for pair in pairs), sum(pair.successes for pair in pairs)
        if tried:
            low, high = wilson_interval(successes, tried)
            parts.append(
                f"in <b>{percent(successes / tried)}</b> of {tried} trials with {escape(SOURCE_TITLES[source])} "
                f"(95\u202f% interval {100 * low:.1f}–{100 * high:.1f}\u202f%)"
            )
    if not parts:
        return '<p class="result">No trial was made.</p>\n'
    said = parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
    return f'<p class="result">The robot lifted both objects {said}.</p>\n'


def headline(content: PageContent) -> str:
    """Return the tiles with the headline figures: one row of the most important, the others folded under it."""
    first, others = headline_tiles(content)
    more = f"<summary>More figures</summary>\n{_tiles(others)}" if others else ""
    return _tiles(first) + (f'<details class="numbers">{more}</details>\n' if more else "")


Tile = tuple[str, str, str]  # class, figure, words


def _tiles(tiles: Sequence[Tile]) -> str:
    return (
        '<div class="tiles">'
        + "".join(
            f'<div class="tile {kind}"><b>{escape(figure)}</b><span>{escape(text)}</span></div>'
            for kind, figure, text in tiles
        )
        + "</div>\n"
    )


def headline_tiles(content: PageContent) -> tuple[list[Tile], list[Tile]]:
    """Return the tiles of the first row, and all others."""
    summary = content.summary
    means: list[Tile] = []
    worst: list[Tile] = []
    others: list[Tile] = []
    for source, pairs in content.trials.items():
        mean, least = (summary[f"evaluate.{source}.{key}"] for key in ("success_rate_mean", "success_rate_min_pair"))
        title = SOURCE_TITLES[source]
        known = source in paper.MEAN_SUCCESS
        beside = f" (paper {percent(paper.MEAN_SUCCESS[source])} over its {paper.PAIRS} pairs)" if known else ""
        means.append(("main", percent(float(mean)), f"mean success over {len(pairs)} pairs, {title}{beside}"))
        published = f" (paper {percent(paper.MINIMUM_SUCCESS[source])})" if source in paper.MINIMUM_SUCCESS else ""
        worst.append(("", percent(float(least)), f"success of the worst pair, {title}{published}"))
        others.append(("", str(summary[f"evaluate.{source}.trials"]), f"trials with the whole robot, {title}"))
        reachable = percent(float(summary[f"evaluate.{source}.reachable_rate"]))
        others.append(("", reachable, f"of grasps within reach of the arm, {title}: moves were found for both picks"))
    survival = percent(float(summary["validate.survival_rate_mean"]))
    made: list[Tile] = [
        ("", str(summary["merge.grasps"]), f"two-object grasps, at least {summary['merge.min_per_pair']} per pair"),
        (
            "",
            str(summary["validate.validated"]),
            f"validated single grasps ({survival} of all chains, mean over objects)",
        ),
    ]
    others += [
        (
            "",
            percent(float(summary["merge.acceptance_rate_mean"])),
            "of random pairs of validated single grasps merge (mean over pairs)",
        ),
        ("", str(summary["scale"]), "scale of this run"),
    ]
    first = [*means, *worst[:1], *made][:MOST_TILES]
    return first, [*worst[1:], *others]


def done_section(content: PageContent) -> str:
    """Return the paragraph that says what this page is about and how success is judged."""
    return (
        "<p>A simulated Panda arm with an Allegro hand picks up a first object with thumb, index and middle finger, "
        "keeps it, and picks up a second object with ring finger and palm. Grasps of single objects are synthesized, "
        "tested in physics, merged into grasps of two objects, tested again, and then carried out on a table with "
        "planned motion from placements that are off by a few millimetres.</p>\n"
        f"<p>A trial succeeds when both objects are at least {100 * content.success_height:g} cm above where they "
        f"rested for {content.hold_seconds:g} s. "
        "Beside it stands the rule of the paper’s released code: both more than 10 cm up at the end of the lift. "
        "Rows that failed are kept in all tables with the first check that they failed; rates are counted from those "
        "rows.</p>\n"
    )


def success_section(content: PageContent, source: str, pairs: Sequence[PairTrials]) -> str:
    """Return heat map, figures per pair, and failure reasons of one source of grasps."""
    if len(pairs) > MOST_PAIRS:
        published = _paper_success(content.summary, f"evaluate.{source}", pairs)
        return success_of_many(source, pairs, content.criterion, published)
    firsts, seconds = list(dict.fromkeys(p.first for p in pairs)), list(dict.fromkeys(p.second for p in pairs))
    rates = {(p.first, p.second): p.success_rate for p in pairs}
    targets = {(p.first, p.second): trials_key(source, p.first, p.second) for p in pairs}
    notes = {(p.first, p.second): f"{p.successes} of {p.trials}" if p.trials else "no trials" for p in pairs}
    rows: list[list[Cell]] = []
    for p in pairs:
        low, high = wilson_interval(p.successes, p.trials)
        interval = f"{100 * low:.0f}–{100 * high:.0f}\u202f%"
        rows.append(
            [
                Link(_pair(p.first, p.second), targets[p.first, p.second]),
                *(str(p.trials), str(p.successes), percent(p.success_rate), interval),
                *(percent(p.success_rate_10cm), percent(p.planning_failure_rate), percent(p.reachable_rate)),
            ]
        )
    summary, prefix = content.summary, f"evaluate.{source}"
    rows.append(
        [
            "mean over pairs",
            *(str(summary[f"{prefix}.trials"]), str(sum(p.successes for p in pairs))),
            *(percent(float(summary[f"{prefix}.success_rate_mean"])), ""),
            percent(float(summary[f"{prefix}.success_rate_mean_10cm"])),
            percent(float(summary[f"{prefix}.planning_failure_rate"])),
            percent(float(summary[f"{prefix}.reachable_rate"])),
        ]
    )
    headers = [
        "pair",
        "trials",
        "successes",
        f"success ({content.criterion})",
        "95 % interval",
        "success (10 cm)",
        "no plan found",
        "grasps in reach",
    ]
    bars = [(_pair(p.first, p.second), {SUCCESS: p.successes, **p.reasons}) for p in pairs]
    cells: dict[tuple[str, str], Cell] = {key: Link(notes[key], targets[key]) for key in notes}
    if len(firsts) * len(seconds) <= MOST_CELLS:
        figure = (
            "<p>Rows: the object picked up first. Columns: the object picked up second. Every cell leads to the pair’s "
            "trials.</p>\n"
            f'<div class="beside">{heat_map(firsts, seconds, rates, notes, targets)}'
            f"{_paper_success(summary, prefix, pairs)}</div>\n"
            + numbers("Heat map: numbers", matrix(firsts, seconds, cells, "first \\ second"))
        )
    else:
        figure = f'<div class="beside">{_paper_success(summary, prefix, pairs)}</div>\n'
    return (
        figure
        + numbers("Every pair: intervals, both rules, plans, reach", table(headers, rows))
        + "<h3>Why trials failed</h3>\n"
        + bars_with_table(bars, SUCCESS, "Outcomes of trials per pair", "pair")
        + explained((reason for p in pairs for reason in p.reasons), TRIALS)
    )


def _paper_success(summary: Mapping[str, Value], prefix: str, pairs: Sequence[PairTrials]) -> str:
    """Return the known figures of the published heat map beside ours."""
    mean, least = float(summary[f"{prefix}.success_rate_mean"]), float(summary[f"{prefix}.success_rate_min_pair"])
    perfect = sum(p.trials > 0 and p.successes == p.trials for p in pairs)
    source = prefix.removeprefix("evaluate.")
    worst = f"{percent(paper.MINIMUM_SUCCESS[source])} (with the lemon)" if source in paper.MINIMUM_SUCCESS else "–"
    rows = [
        [
            "mean over pairs",
            percent(mean),
            percent(paper.MEAN_SUCCESS[source]) if source in paper.MEAN_SUCCESS else "–",
        ],
        ["worst pair", percent(least), worst],
        ["pairs at 100 %", str(perfect), str(paper.PERFECT_CELLS.get(source, "–"))],
        ["pairs", str(len(pairs)), str(paper.PAIRS)],
        ["trials per pair", " / ".join(str(n) for n in sorted({p.trials for p in pairs})), str(paper.TRIALS_PER_PAIR)],
    ]
    note = (
        '<p class="note">Of the published heat map only these figures are known here, not its single cells. Its pairs '
        "are those of sixteen objects, so that the two means are over different pairs.</p>"
    )
    return f"<div>{table(['', 'here', 'paper'], rows)}{note}</div>"


def pairs_section(content: PageContent) -> str:
    """Return, for every pair that is shown, its grasp in 3D, the strips of its trials, and the folded tables of both.

    Pairs that no view shows get a place for those of their trials that something leads to.
    """
    legend = (
        "<p>Left: merged grasps in the frame of the hand (first object orange, second blue); drag to turn, "
        "scroll to zoom. Right: moments of one trial, named by the phase of the sequence; the command beside its "
        "number plays it (docs/replay.md).</p>\n"
    )
    if content.worst:
        legend = (
            f"<p>Of {max(map(len, content.trials.values()))} pairs, the {len(content.worst)} with the smallest share "
            "of successes over the trials of all sources, each with a trial that failed for the commonest reason.</p>\n"
            f"{every_row()}{worst_table(content.worst, content.trials, PAIR_KEY)}{legend}"
        )
    views = [_pair_view(view, _trial_folds(view.first, view.second, content.trial_tables)) for view in content.views]
    seen = {(view.first, view.second) for view in content.views}
    others = dict.fromkeys((first, second) for _, first, second in content.trial_tables if (first, second) not in seen)
    folds = [
        f'<div class="pair" id="{escape(pair_key(*pair))}"><h3>{escape(_pair(*pair))}</h3>'
        f'<div class="rows">{_trial_folds(*pair, content.trial_tables)}</div></div>\n'
        for pair in others
    ]
    return "".join([legend, *views, *folds])


def _trial_folds(first: str, second: str, trial_tables: Mapping[tuple[str, str, str], FoldedTable]) -> str:
    folds = []
    for (source, *pair), found in trial_tables.items():
        if pair != [first, second]:
            continue
        title = SOURCE_TITLES.get(source, f"harder setting {source.removeprefix(PREFIX)}")
        good = sum(row[1] == SUCCESS for row in found.rows)
        folds.append(fold(trials_key(source, first, second), f"Trials, {title}: {good} of {len(found.rows)} succeed"))
    return "".join(folds)


def _pair_view(view: PairView, folds: str) -> str:
    title = f"<h3>{escape(_pair(view.first, view.second))}</h3>"
    strips = (
        "".join(_strip(strip, view) for strip in view.strips)
        or '<p class="note">No trial of this pair has pictures.</p>'
    )
    begin, end = f'<div class="pair" id="{escape(pair_key(view.first, view.second))}">{title}', "</div>\n"
    trials = f'<div class="rows">{folds}</div>'
    if not view.grasps:
        return f'{begin}<p class="note">No merged grasp was accepted.</p><div>{strips}</div>{trials}{end}'
    alternative = f"Merged grasp {view.grasps[0]['merged_id']} of {_pair(view.first, view.second)}"
    poster = image(view.poster, alternative, (1, 1)) if view.poster else ""
    options = "".join(
        f'<option value="{index}">{grasp["merged_id"]}</option>' for index, grasp in enumerate(view.grasps)
    )
    label = f"merged grasp of {escape(_pair(view.first, view.second))}"
    poses = fold(grasps_key(view.first, view.second), f"Merged grasps: numbers of the {len(view.rows)} shown")
    return (
        f'{begin}<div><div class="view" data-pair="{escape(view.name)}">{poster}</div>'
        f'<p class="under screen">Merged grasp <select aria-label="{label}">{options}</select></p></div>'
        f'<div>{strips}</div><div class="rows">{poses}{folds}</div>{end}'
    )


def _figure(strip: Strip, moment: int) -> str:
    caption = strip.captions[moment]
    picture = image(strip.pictures[moment], caption, strip.shape)
    return f"<figure>{picture}<figcaption>{escape(caption)}</figcaption></figure>"


def _strip(strip: Strip, view: PairView) -> str:
    figures = "".join(_figure(strip, moment) for moment in range(len(strip.captions)))
    kind = ' class="failed"' if strip.failed else ""
    target = trials_key(strip.source, view.first, view.second)
    title = f'<a href="{anchor(target)}" data-row="{strip.trial}">{escape(strip.title)}</a>'
    title += f" <code>{escape(strip.replay)}</code>" if strip.replay else ""
    return f'<div{kind}><p class="strip-title">{title}</p><div class="strip">{figures}</div></div>\n'


def single_section(funnels: Sequence[Funnel]) -> str:
    """Return rates per object beside Table I of the paper, and what the others were rejected by."""
    explanation = (
        "<p>A chain gives one candidate, the best of its starts (<code>synthesize.*.starts</code>, each a run of the "
        "optimiser); the filter sets limits on the terms of its energy; the "
        "grasps that pass it are tested in physics.</p>\n"
        "<p>The two columns of rates are not the same measure. Ours: grasps that passed every check of physics "
        "(contact <em>and</em> drift in six gravity directions, execution from a table) per chain run. Table I of the "
        "paper: successes per batch under its own schedule, its own table simulation and its rule that some contact "
        "remains. The last column applies that rule to the grasps here on which it was decided.</p>\n"
    )
    if len(funnels) > MOST_PAIRS:
        return explanation + singles_of_many(funnels)
    names = [(f"{_spoken(f.object_name)} ({f.style})", f) for f in funnels]
    chains = [(name, {PASSED: f.passed, **f.synthesize_rejected}) for name, f in names]
    physics = [(name, {PASSED: f.validated, **f.validate_rejected}) for name, f in names]
    return (
        f"{explanation}{table(SINGLE_HEADERS, [single_row(f) for f in funnels])}"
        "<h3>Synthesis: chains by the first check of the filter that they failed</h3>\n"
        + bars_with_table(chains, PASSED, "Fate of chains per object", "object")
        + explained((check for f in funnels for check in f.synthesize_rejected), SYNTHESIS)
        + "<h3>Validation: grasps that passed the filter, by the first check of physics that they failed</h3>\n"
        + bars_with_table(physics, PASSED, "Fate of tested grasps per object", "object")
        + explained((check for f in funnels for check in f.validate_rejected), VALIDATION)
    )


def merge_section(content: PageContent) -> str:
    """Return the fates of all combinations per pair."""
    merges = content.merges
    if len(merges) > MOST_PAIRS:
        counts = [one for one in content.counts if one.source == SYNTHESIZED]
        return merges_of_many(merges, counts, content.drift_limit)
    bars = [(_pair(m.first, m.second), {PASSED: m.accepted, **m.rejected}) for m in merges]
    return (
        "<p>Combinations of a pinch grasp and a side grasp that were tried for each pair, by the first check that they "
        "failed. Combinations are tried in random order until enough are accepted, so the counts differ.</p>\n"
        + bars_with_table(bars, PASSED, "Fate of combinations per pair", "pair")
        + explained((check for m in merges for check in m.rejected), MERGE)
    )


def settings_section(settings: Mapping[str, Sequence[Row]]) -> str:
    """Return all parameters, one table to open per section of ``params.yaml``."""
    folds = "".join(
        f'<details><summary>{escape(section)}</summary><div class="settings">'
        f"{table(['parameter', 'value', 'meaning'], _shortened(section, rows))}</div></details>\n"
        for section, rows in settings.items()
    )
    return (
        "<p>All of <code>params.yaml</code> on which results depend. What differs from the paper, and why, is in "
        f"<code>docs/departures.md</code>.</p>\n{folds}"
    )


def _shortened(section: str, rows: Sequence[Row]) -> list[Row]:
    """Return rows and values as far as a page can show them; params.yaml has them all."""
    shown = [
        (name, value if len(value) <= MOST_LETTERS else f"{value[:MOST_LETTERS]} … ({len(value)} letters)", meaning)
        for name, value, meaning in rows[:MOST_SETTINGS]
    ]
    left = len(rows) - len(shown)
    return [*shown, (section, f"… {left} more values", "In params.yaml.")] if left else shown


def versions_section(versions: Mapping[str, str]) -> str:
    """Return package versions, and where to find durations."""
    return (
        "<p>How long each stage took is in MLflow and in <code>reports/durations.json</code>: they differ from run "
        "to run, and this page does not.</p>\n"
        + table(["package", "version"], [[name, version] for name, version in sorted(versions.items())])
    )
