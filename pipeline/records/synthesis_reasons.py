"""Why the synthesis rejects a candidate: ``rejected_by`` in the tables of ``synthesize``."""

from __future__ import annotations

from pipeline.records.reasons import Reason


class SynthesisReason(Reason):
    """Checks of the final score against the exact mesh, in their order."""

    JOINTS = "joints", "a joint is beyond its limits"
    DISTANCE = "distance", "contact points are not on the object's surface"
    FORCE_CLOSURE = "force_closure", "contact forces do not balance: the object would turn or slide"
    PENETRATION = "penetration", "the hand overlaps the object"
    TABLE = "table", "the hand is too low over the plane that the object stands on"
    SELF_PENETRATION = "self_penetration", "the fingers overlap each other"
    DUPLICATE = "duplicate", "nearly the same as a better grasp of the same object"
