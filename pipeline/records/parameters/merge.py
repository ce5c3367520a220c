"""`merge`: grasps of several objects from validated single-object grasps."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from pipeline.records.parameters.section import Section


class MergeParameters(Section):
    """How many two-object grasps are wanted per pair, and which checks they must pass."""

    grasps_per_pair: int = Field(40, ge=1, description="Accepted two-object grasps wanted per pair.")
    most_combinations: int = Field(
        400, ge=1, description="Maximum number of combinations tried per pair, in random order."
    )
    clearance: float = Field(
        0.001,
        description="[m] Minimum distance between an object and the other object, and between an object and the "
        "fingers that do not hold it.",
    )
    penetration_tolerance: float = Field(
        0.001,
        ge=0,
        description="[m] Penetration tolerated along swept approaches, with the support, and between fingers.",
    )
    mount_clearance: float = Field(
        0.003, description="[m] Minimum height of the arm's flange and the hand's mount above the support of object 1."
    )
    approach_lengths: list[Annotated[float, Field(gt=0, le=0.5)]] = Field(
        [0.2, 0.12, 0.07],
        min_length=1,
        description="[m] Lengths to try for the straight approach to object 1; the first that is free of collisions is "
        "used.",
    )
    physics_test: bool = Field(
        True, description="Also test whether the hand holds both objects under gravity from all directions."
    )
    approach_clearance: float | None = Field(
        None,
        ge=0,
        description="[m] Minimum distance of the hand to each object after the first on the straight approach to it, "
        "except where they touch at the end; null: they must only not overlap. Needed with more than two objects, "
        "where fingers that hold other objects cannot open.",
    )
    most_per_grasp: int = Field(
        4, ge=1, description="Maximum number of accepted two-object grasps that share a single-object grasp."
    )
    distinct_distance: float = Field(
        0.003,
        ge=0,
        description="[m] Single-object grasps whose hand surfaces are closer than this on average are treated as "
        "duplicates.",
    )
