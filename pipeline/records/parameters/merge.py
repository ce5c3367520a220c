"""`merge`: grasps of several objects from validated single ones."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from pipeline.records.parameters.section import Section


class MergeParameters(Section):
    """How many two-object grasps per pair, and what they must pass."""

    grasps_per_pair: int = Field(40, ge=1, description="Accepted grasps wanted per pair.")
    most_combinations: int = Field(400, ge=1, description="Combinations tried per pair, in random order.")
    clearance: float = Field(
        0.001, description="Least distance of an object to the other one and to fingers that do not hold it, m."
    )
    penetration_tolerance: float = Field(
        0.001, ge=0, description="Overlap in sweeps, with the support and between fingers that counts as none, m."
    )
    mount_clearance: float = Field(
        0.003, description="Least height of flange and mount over the support of object 1, m."
    )
    approach_lengths: list[Annotated[float, Field(gt=0, le=0.5)]] = Field(
        [0.2, 0.12, 0.07], min_length=1, description="Straight second approach, m, longest that is free."
    )
    approach_clearance: float | None = Field(
        None,
        ge=0,
        description="Least distance to an object after the first on the straight way to it, m; of all but what touches "
        "it at the end. Fingers that hold other objects cannot open for it. null: touching nothing is enough.",
    )
    physics_test: bool = Field(True, description="Six gravities with both objects in the hand.")
    most_per_grasp: int = Field(
        4, ge=1, description="Accepted pairs that may share one single grasp (distinct results)."
    )
    distinct_distance: float = Field(
        0.003, ge=0, description="Single grasps closer than this, m on average over the hand's surface, count as one."
    )
