"""Why a combination of single grasps is rejected: ``rejected_by`` in the tables of ``merge`` and ``sample``."""

from __future__ import annotations

from pipeline.records.reasons import Reason


class MergeReason(Reason):
    """Checks of ``pairing.combination``, in their order."""

    FINGERS = "fingers", "both grasps need the same finger"
    SETTLING = "settling", "the first object moves too far when the fingers squeeze it"
    OBJECT_CLEARANCE = "object_clearance", "the two objects overlap or nearly touch"
    HAND_CLEARANCE = (
        "hand_clearance",
        "an object overlaps or nearly touches a part of the hand that does not hold it",
    )
    SELF_CLEARANCE = "self_clearance", "the ring finger overlaps another finger"
    MOUNT_CLEARANCE = (
        "mount_clearance",
        "the arm's flange would be too low over the support of the second object",
    )
    SUPPORT_CLEARANCE = (
        "support_clearance",
        "the hand or the first object would go into the support of the second object",
    )
    FIRST_APPROACH = (
        "first_approach",
        "no opening of the hand leads to the first object without touching something",
    )
    SECOND_APPROACH = (
        "second_approach",
        "no straight line leads to the second object without touching something, the first in the hand",
    )
    THIRD_APPROACH = (
        "third_approach",
        "no straight line leads to the third object without touching something, two in the hand",
    )
    FOURTH_APPROACH = (
        "fourth_approach",
        "no straight line leads to the fourth object without touching something, three in the hand",
    )
    RING_MOTION = "ring_motion", "the ring finger touches something while it closes on its object"
    MIDDLE_MOTION = "middle_motion", "the middle finger touches something while it closes on its object"
    INDEX_MOTION = "index_motion", "the index finger touches something while it closes on its object"
    GRAVITY = "gravity", "with all objects in the hand, one was lost or moved too far in some gravity direction"
