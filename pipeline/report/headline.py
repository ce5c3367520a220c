"""The top of the page: a successful trial as film and pictures, the result in a sentence, headline figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from pipeline.records.opening_film import OpeningFilm
from pipeline.report import paper
from pipeline.report.chosen_trials import chosen_moments
from pipeline.report.pair_views import PairView
from pipeline.report.rates import PairTrials, wilson_interval
from pipeline.report.rendering import render
from pipeline.report.summary import Value
from pipeline.report.trial_rows import replay_command
from pipeline.report.wording import SOURCE_TITLES, interval, percent

MOST_TILES = 6  # in the first row
MOST_PICTURES = 6


@dataclass(frozen=True)
class Result:
    """How often the robot succeeded with the grasps of one source."""

    title: str
    trials: int  # at least one
    rate: float
    interval: str  # 95 %


@dataclass(frozen=True)
class Tile:
    """One headline figure."""

    figure: str
    text: str
    main: bool = False


def headline(
    film: OpeningFilm | None,
    opening: PairView | None,
    trials: Mapping[str, Sequence[PairTrials]],
    summary: Mapping[str, Value],
) -> Markup:
    """Return the top of the page.

    Args:
        film: of one successful trial; None where there is none.
        opening: its pair, with the strip of the same trial.
        trials: counts per source and pair.
    """
    first, others = tiles(trials, summary)
    return render(
        "header.html",
        film=film,
        command=replay_command(film.source, film.objects, film.trial) if film else "",
        opening=opening,
        moments=_moments(opening),
        results=results(trials),
        first=first,
        others=others,
    )


def _moments(opening: PairView | None) -> list[tuple[bytes, str]]:
    if opening is None:
        return []
    strip = opening.strips[0]
    return [
        (strip.pictures[moment], strip.captions[moment]) for moment in chosen_moments(strip.captions, MOST_PICTURES)
    ]


def results(trials: Mapping[str, Sequence[PairTrials]]) -> list[Result]:
    """Return the share of all trials that succeed, per source that has any."""
    found = []
    for source, pairs in trials.items():
        tried, successes = sum(pair.trials for pair in pairs), sum(pair.successes for pair in pairs)
        if tried:
            ends = interval(*wilson_interval(successes, tried), digits=1)
            found.append(Result(SOURCE_TITLES[source], tried, successes / tried, ends))
    return found


def tiles(trials: Mapping[str, Sequence[PairTrials]], summary: Mapping[str, Value]) -> tuple[list[Tile], list[Tile]]:
    """Return the tiles of the first row, and all others."""
    means: list[Tile] = []
    worst: list[Tile] = []
    others: list[Tile] = []
    for source, pairs in trials.items():
        title, own = SOURCE_TITLES[source], f"evaluate.{source}"
        published = _published(paper.MEAN_SUCCESS.get(source), f" over its {paper.PAIRS} pairs")
        text = f"mean success over {len(pairs)} pairs, {title}{published}"
        means.append(Tile(percent(float(summary[f"{own}.success_rate_mean"])), text, main=True))
        text = f"success of the worst pair, {title}{_published(paper.MINIMUM_SUCCESS.get(source))}"
        worst.append(Tile(percent(float(summary[f"{own}.success_rate_min_pair"])), text))
        others.append(Tile(str(summary[f"{own}.trials"]), f"trials with the whole robot, {title}"))
        text = f"of grasps within reach of the arm, {title}: moves were found for both picks"
        others.append(Tile(percent(float(summary[f"{own}.reachable_rate"])), text))
    survival = percent(float(summary["validate.survival_rate_mean"]))
    acceptance = percent(float(summary["merge.acceptance_rate_mean"]))
    made = [
        Tile(str(summary["merge.grasps"]), f"two-object grasps, at least {summary['merge.min_per_pair']} per pair"),
        Tile(
            str(summary["validate.validated"]),
            f"validated single grasps ({survival} of all chains, mean over objects)",
        ),
    ]
    others += [
        Tile(acceptance, "of random pairs of validated single grasps merge (mean over pairs)"),
        Tile(str(summary["scale"]), "scale of this run"),
    ]
    return [*means, *worst[:1], *made][:MOST_TILES], [*worst[1:], *others]


def _published(rate: float | None, over: str = "") -> str:
    return "" if rate is None else f" (paper {percent(rate)}{over})"
