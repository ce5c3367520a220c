"""One line on every check and every reason of failure, in the words of a reader who has not seen the code."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from html import escape

from pipeline.records.merge_reasons import MergeReason
from pipeline.records.trial_reasons import TrialReason

GRAVITY = "gravity:"  # how checks of one gravity direction begin

SYNTHESIS = {
    "joints": "a joint is beyond its limits",
    "distance": "contact points are not on the object's surface",
    "force_closure": "contact forces do not balance: the object would turn or slide",
    "penetration": "the hand overlaps the object",
    "table": "the hand is too low over the plane that the object stands on",
    "self_penetration": "the fingers overlap each other",
    "duplicate": "nearly the same as a better grasp of the same object",
}
VALIDATION = {
    GRAVITY: "under gravity in this direction of the object's frame no assigned link presses at the end, or the object "
    "moved or turned too far in the hand",
    "approach": "no straight line leads the open hand to the grasp without touching the object or its support",
    "table:push": "the object was pushed away before the fingers closed",
    "table:touch": "the hand pressed on the support",
    "table:drop": "the object was not held when the support was taken away",
    "table:drift": "the object moved or turned too far in the hand when the support was taken away",
    "settling": "a pinched object slid too far when the fingers closed gently, without gravity",
    "not_tested": "left out, as enough candidates of this object were tested",
}
MERGE = {reason.value: reason.meaning for reason in MergeReason}
TRIALS = {reason.value: reason.meaning for reason in TrialReason}


def meaning_of(check: str, meanings: Mapping[str, str]) -> str:
    """Return the line on ``check``, '' if there is none; checks of single gravity directions share one."""
    return meanings.get(GRAVITY if check.startswith(GRAVITY) else check, "")


def explained(checks: Iterable[str], meanings: Mapping[str, str]) -> str:
    """Return an HTML list with the meanings of ``checks``, in the order in which they are made."""
    lines: dict[str, list[str]] = {}
    for check in sorted(set(checks)):
        lines.setdefault(meaning_of(check, meanings), []).append(check.replace("_", " "))
    ordered = [text for text in meanings.values() if text in lines]
    items = "".join(f"<dt>{escape(', '.join(lines[text]))}</dt><dd>{escape(text)}</dd>" for text in ordered)
    return f"<dl>{items}</dl>\n" if items else ""
