"""One line on every check and every reason of failure, in the words of a reader who has not seen the code."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from html import escape

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
MERGE = {
    "fingers": "both grasps need the same finger",
    "settling": "the first object moves too far when the fingers squeeze it",
    "object_clearance": "the two objects overlap or nearly touch",
    "hand_clearance": "an object overlaps or nearly touches a part of the hand that does not hold it",
    "self_clearance": "the ring finger overlaps another finger",
    "mount_clearance": "the arm's flange would be too low over the support of the second object",
    "support_clearance": "the hand or the first object would go into the support of the second object",
    "first_approach": "no opening of the hand leads to the first object without touching something",
    "second_approach": "no straight line leads to the second object without touching something, the first in the hand",
    "ring_motion": "the ring finger touches something while it closes on the second object",
    "gravity": "with both objects in the hand, one was lost or moved too far in some gravity direction",
}
TRIALS = {
    "no grasp": "no two-object grasp was accepted for the pair, so there was nothing to try",
    "plan first": "no collision-free motion of the arm to the first object was found, for any grasp tried",
    "plan second": "no collision-free motion to the second object was found, the first in the hand",
    "collision on approach": "an object was pushed before the fingers closed on it",
    "first slip": "the first object did not come along when the hand was lifted",
    "first lost in transit": "the first object slid far in the hand or left it before the end of the last lift",
    "second slip": "the second object was not high enough at the end of the last lift",
    "dropped in hold": "an object sank below the height of success during the hold",
    "simulation diverged": "physics gave poses that are not numbers",
}


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
