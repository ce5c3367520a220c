"""One line on every check and every reason of failure, in the words of a reader who has not seen the code."""

from __future__ import annotations

from collections.abc import Mapping

from pipeline.records.reasons import Reason
from pipeline.records.synthesis_reasons import SynthesisReason
from pipeline.records.validation_reasons import ValidationReason


def meanings_of(reasons: type[Reason]) -> dict[str, str]:
    """Return the meaning of every reason by its value, in the order of the checks."""
    return {reason.value: reason.meaning for reason in reasons}


SYNTHESIS = meanings_of(SynthesisReason)
VALIDATION = meanings_of(ValidationReason)
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


def meaning_of(reason: str, meanings: Mapping[str, str]) -> str:
    """Return the line on a reason, '' if there is none; what stands after a colon may be a detail, as a direction."""
    return meanings.get(reason) or meanings.get(reason.partition(":")[0], "")
