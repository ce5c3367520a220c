"""`robustness`: how well grasps that passed all checks hold: margins, lowest friction, share of conditions survived."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, field_validator

from pipeline.records.parameters.section import Section

Interval = tuple[float, float]


class RobustnessParameters(Section):
    """Measures of single and merged grasps; no grasp is rejected by them."""

    friction: float = Field(
        0.5, gt=0, le=5, description="Friction coefficient of every contact for the margins of weight and pushes."
    )
    single_grasps: bool = Field(
        False, description="Also measure single grasps in physics, not only merged ones; margins are always computed."
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
    friction_range: Interval = Field((0.3, 0.9), description="Friction coefficient of every two touching bodies.")
    mass_range: Interval = Field(
        (0.5, 2.0), description="Mass by the prepared mass, drawn with uniform logarithm; inertia scales with it."
    )
    torque_range: Interval = Field((0.35, 0.7), description="[N m] Torque limit of the hand's joints.")
    centre_offset: float = Field(
        0.01, ge=0, le=0.05, description="[m] Maximum distance of the centre of mass from the prepared one."
    )
    position_error: float = Field(
        0.005, ge=0, le=0.05, description="[m] Maximum distance of an object from its place in the grasp as it closes."
    )
    rotation_error: float = Field(
        0.08727,
        ge=0,
        le=1.0,
        description="[rad] Maximum angle, about any axis, of an object from its pose in the grasp as it closes.",
    )
    opening: float = Field(
        0.008,
        ge=0,
        le=0.05,
        description="[m] How far the contact points move outwards before the hand closes on displaced objects.",
    )
    hold_seconds: float = Field(0.8, gt=0, le=20, description="[s] Time for which the objects must be held.")
    shove_force: float = Field(
        1.0, ge=0, le=100, description="[N] Maximum force on each object, in any direction, half-way through the hold."
    )
    shove_seconds: float = Field(0.1, gt=0, le=2, description="[s] Duration of the shove.")

    @field_validator("ladder")
    @classmethod
    def _falls(cls, ladder: list[float]) -> list[float]:
        if any(low >= high for high, low in zip(ladder, ladder[1:], strict=False)):
            raise ValueError("the values must fall; sort them from the largest to the smallest, each once")
        return ladder

    @field_validator("friction_range", "mass_range", "torque_range")
    @classmethod
    def _is_positive_and_rising(cls, interval: Interval) -> Interval:
        low, high = interval
        if not 0 < low <= high:
            raise ValueError(f"[{low:g}, {high:g}] must be positive and rise; write the smaller value first")
        return interval
