"""How the page writes names and shares, and the ids by which links find what they lead to."""

from __future__ import annotations

import re
from urllib.parse import quote

from pipeline.records.series import series_of
from pipeline.records.sources import SOURCES

SOURCE_TITLES = {name: source.title for name, source in SOURCES.items()}
UNKNOWN = "–"  # a figure that there is not
PASSED, SUCCESS = "passed", "success"  # in place of a reject reason, or of a reason of failure
PLACES = {"first": "picked up first", "second": "picked up second"}


def percent(rate: float) -> str:
    """Return a rate as text with one decimal, such as 82.7 %."""
    return f"{100 * rate:.1f}\u202f%"


def interval(low: float, high: float, digits: int) -> str:
    """Return the two ends of an interval of rates as text."""
    return f"{100 * low:.{digits}f}–{100 * high:.{digits}f}\u202f%"


def spoken(name: str) -> str:
    """Return a name of a file, a column or a condition in words: ``mu_0_5`` is mu 0.5."""
    return re.sub(r"(?<=\d)_(?=\d)", ".", name).replace("_", " ")


def pair_title(first: str, second: str) -> str:
    """Return what a pair is called."""
    return f"{spoken(first)} + {spoken(second)}"


def trials_title(source: str) -> str:
    """Return what the trials of a source, or of a series, are called."""
    series = series_of(source)
    if series is None:
        return SOURCE_TITLES[source]
    return f"{SOURCE_TITLES[series.source]}: {spoken(series.condition)}, {series.engine}"


def anchor(target: str) -> str:
    """Return the ``href`` that leads to the element with the id ``target``."""
    return "#" + quote(target)


def pair_key(first: str, second: str) -> str:
    """Return the id of what is shown of a pair."""
    return f"pair-{first}--{second}"


def grasps_key(first: str, second: str) -> str:
    """Return the id of the table of a pair's merged grasps."""
    return f"grasps-{first}--{second}"


def trials_key(source: str, first: str, second: str) -> str:
    """Return the id of the table of a pair's trials; ``source`` may also be a series."""
    return f"trials-{source}-{first}--{second}"


def objects_key(source: str, place: str) -> str:
    """Return the id of the table of all objects at one place of a pair."""
    return f"objects-{source}-{place}"


def singles_key(style: str) -> str:
    """Return the id of the table of all objects in one style."""
    return f"singles-{style}"
