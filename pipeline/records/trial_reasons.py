"""Why a robot trial fails: ``reason`` in the tables of ``evaluate``."""

from __future__ import annotations

from pipeline.records.reasons import Reason


class TrialReason(Reason):
    """What ends a trial early, in the order in which it can happen."""

    NO_GRASP = "no grasp", "no grasp of these objects was accepted, so there was nothing to try"
    PLAN_FIRST = (
        "plan first",
        "no collision-free motion of the arm to the first object was found, for any grasp tried",
    )
    PLAN_SECOND = (
        "plan second",
        "no collision-free motion to the second object was found, the first in the hand",
    )
    PLAN_THIRD = "plan third", "no collision-free motion to the third object was found, two in the hand"
    PLAN_FOURTH = "plan fourth", "no collision-free motion to the fourth object was found, three in the hand"
    COLLISION_ON_APPROACH = "collision on approach", "an object was pushed before the fingers closed on it"
    FIRST_SLIP = "first slip", "the first object did not come along when the hand was lifted"
    FIRST_LOST = (
        "first lost in transit",
        "the first object slid far in the hand or left it before the end of the last lift",
    )
    SECOND_SLIP = "second slip", "the second object was not high enough at the end of its lift"
    SECOND_LOST = (
        "second lost in transit",
        "the second object slid far in the hand or left it before the end of the last lift",
    )
    THIRD_SLIP = "third slip", "the third object was not high enough at the end of its lift"
    THIRD_LOST = (
        "third lost in transit",
        "the third object slid far in the hand or left it before the end of the last lift",
    )
    FOURTH_SLIP = "fourth slip", "the fourth object was not high enough at the end of the last lift"
    DROPPED = "dropped in hold", "an object sank below the height of success during the hold"
    DIVERGED = "simulation diverged", "physics gave poses that are not numbers"
