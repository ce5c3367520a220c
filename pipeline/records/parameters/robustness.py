"""`robustness`: how well grasps that passed all checks hold: margins, lowest friction, share of conditions survived."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, field_validator

from pipeline.records.parameters.distribution import DisturbedGrasp
from pipeline.records.parameters.section import Section


class RobustnessParameters(Section):
    """Measures of single and merged grasps; no grasp is rejected by them."""

    friction: float = Field(
        0.5, gt=0, le=5, description="Friction coefficient of every contact for the margins of weight and pushes."
    )
    single_grasps: bool = Field(
        False, description="Also measure single grasps in physics, not only merged ones; margins are always computed."
    )
    merged_grasps: int | None = Field(
        None,
        ge=1,
        description="Accepted merged grasps of each pair that are measured, the first in the order in which they were "
        "tried, which is random; null measures all. Trials take measured grasps before others.",
    )
    ladder: list[Annotated[float, Field(gt=0, le=5)]] = Field(
        [0.9, 0.7, 0.6, 0.5, 0.4, 0.3],
        description="Falling friction coefficients of every two touching bodies among which the lowest is sought at "
        "which a grasp holds; [] leaves it out.",
    )
    conditions: int = Field(
        16,
        ge=0,
        le=10000,
        description="Conditions drawn for the grasps of an object or a pair, the same for all of them; 0 leaves them "
        "out.",
    )
    distribution: DisturbedGrasp = Field(DisturbedGrasp.model_validate({}))
    opening: float = Field(
        0.008,
        ge=0,
        le=0.05,
        description="[m] How far the contact points move outwards before the hand closes on displaced objects.",
    )
    hold_seconds: float = Field(0.8, gt=0, le=20, description="[s] Time for which the objects must be held.")

    @field_validator("ladder")
    @classmethod
    def _falls(cls, ladder: list[float]) -> list[float]:
        if any(low >= high for high, low in zip(ladder, ladder[1:], strict=False)):
            raise ValueError("the values must fall; sort them from the largest to the smallest, each once")
        return ladder
