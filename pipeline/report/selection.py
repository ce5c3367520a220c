"""Which pairs the page shows, and what of each: all where they are few, else those that fare worst."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from pipeline.records.opening_film import OpeningFilm
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.report import ReportParameters
from pipeline.report.conditions import Tried
from pipeline.report.counting import SYNTHESIZED
from pipeline.report.drawing import Look, Request, full_look, small_look
from pipeline.report.headline import MOST_PICTURES
from pipeline.report.rates import MOST_PAIRS, PairTrials
from pipeline.report.worst import WorstPair, worst_pairs

Pair = tuple[str, str]


@dataclass(frozen=True)
class Plan:
    """What is to be drawn."""

    shown: list[Request]  # pairs with grasps and strips, in the order of the page
    listed: list[Request]  # other pairs whose trials something on the page leads to
    opening: Request | None  # the trial that the film shows, where no strip of a shown pair is of it
    worst: list[WorstPair] = field(default_factory=list)


def plan(
    trials: Mapping[str, Sequence[PairTrials]],
    tried: Sequence[Tried],
    settings: ReportParameters,
    evaluate: EvaluateParameters,
    film: OpeningFilm | None,
) -> Plan:
    """Return which pairs are drawn, and whose trials are listed.

    Args:
        trials: per source, counts of every pair.
        tried: series that are compared with standard trials.
        film: with which the page opens.
    """
    sources: dict[Pair, list[str]] = {}
    for source, pairs in trials.items():
        for pair in pairs:
            sources.setdefault((pair.first, pair.second), []).append(source)
    full, bare = full_look(settings), Look(settings.picture_width, settings.picture_height, 0, grasps=0)

    def request(pair: Pair, strips: tuple[tuple[str, bool], ...], listed: Sequence[str], look: Look) -> Request:
        return Request(*pair, strips=strips, listed=tuple(listed), look=look, evaluate=evaluate)

    if max(map(len, trials.values()), default=0) <= MOST_PAIRS:
        shown = [
            request(pair, tuple((source, failed) for source in own for failed in (False, True)), own, full)
            for pair, own in sources.items()
            if SYNTHESIZED in own
        ]
        others = [request(pair, (), own, bare) for pair, own in sources.items() if SYNTHESIZED not in own]
        return Plan(shown, others, opening_request(film, shown, full, evaluate))
    worst = worst_pairs(trials)
    small = small_look(settings)
    shown = [
        request((one.first, one.second), ((one.source, True),), sources[one.first, one.second], small) for one in worst
    ]
    linked = [
        (source, (one.first, one.second)) for source, own in trials.items() if len(own) <= MOST_PAIRS for one in own
    ] + [(one.series.source, names) for one in tried for names in one.shown]
    linked_to: dict[Pair, list[str]] = {}
    for source, names in dict.fromkeys(linked):
        if names not in {(one.first, one.second) for one in worst}:
            linked_to.setdefault(names, []).append(source)
    return Plan(
        shown,
        [request(pair, (), own, bare) for pair, own in linked_to.items()],
        opening_request(film, shown, full, evaluate),
        worst,
    )


def opening_request(
    film: OpeningFilm | None, shown: Sequence[Request], full: Look, evaluate: EvaluateParameters
) -> Request | None:
    """Return what is to be drawn of the filmed trial; None where a pair that is shown has pictures of it."""
    if film is None:
        return None
    pair, strip = film.objects, (film.source, False)
    if any((one.first, one.second) == pair and strip in one.strips for one in shown):
        return None
    look = Look(full.width, full.height, MOST_PICTURES, grasps=0)
    return Request(pair[0], pair[1], strips=(strip,), listed=(), look=look, evaluate=evaluate)
