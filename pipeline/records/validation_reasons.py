"""Why physics rejects a candidate: ``rejected_by`` in the tables of ``validate``."""

from __future__ import annotations

from pipeline.records.reasons import Reason


class ValidationReason(Reason):
    """Checks of ``validate.checks``, in their order; a table names the direction of gravity after a colon."""

    GRAVITY = (
        "gravity",
        "under gravity in this direction of the object's frame no assigned link presses at the end, or the object "
        "moved or turned too far in the hand",
    )
    APPROACH = (
        "approach",
        "no straight line leads the open hand to the grasp without touching the object or its support",
    )
    TABLE_PUSH = "table:push", "the object was pushed away before the fingers closed"
    TABLE_TOUCH = "table:touch", "the hand pressed on the support"
    TABLE_DROP = "table:drop", "the object was not held when the support was taken away"
    TABLE_DRIFT = "table:drift", "the object moved or turned too far in the hand when the support was taken away"
    SETTLING = "settling", "a pinched object slid too far when the fingers closed gently, without gravity"
    NOT_TESTED = "not_tested", "left out, as enough candidates of this object were tested"
