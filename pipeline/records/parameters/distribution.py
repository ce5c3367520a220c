"""Ranges from which the conditions of a grasp are drawn: those of `robustness`, and those of trials in `conditions`."""

from __future__ import annotations

from pydantic import Field, field_validator

from pipeline.records.parameters.section import Section

Interval = tuple[float, float]


class DisturbedGrasp(Section):
    """What may differ from the setting that a grasp was made for; every object has its own draw."""

    friction: Interval = Field((0.3, 0.9), description="Friction coefficient of every two touching bodies.")
    mass_factor: Interval = Field(
        (0.5, 2.0), description="Mass by the prepared mass, drawn with uniform logarithm; inertia scales with it."
    )
    centre_offset: float = Field(
        0.01, ge=0, le=0.05, description="[m] Maximum distance of the centre of mass from the prepared one."
    )
    position_error: float = Field(
        0.01,
        ge=0,
        le=0.1,
        description="[m] Maximum distance of an object from where the hand believes it to be. In trials it is "
        "horizontal: the height of what the object stands on is known.",
    )
    rotation_error: float = Field(
        0.17453,
        ge=0,
        le=1.6,
        description="[rad] Maximum angle, about any axis, between how an object is turned and how the hand believes it "
        "to be.",
    )
    torque_limit: Interval = Field((0.35, 0.7), description="[N m] Torque limit of the hand's joints.")
    shove_force: float = Field(
        1.0,
        ge=0,
        le=100,
        description="[N] Maximum force, in any direction, on each object in the hand: half-way through the hold, and "
        "in trials half-way to every further object, too.",
    )
    shove_seconds: float = Field(0.1, gt=0, le=2, description="[s] Duration of a shove.")

    @field_validator("friction", "mass_factor", "torque_limit")
    @classmethod
    def _is_positive_and_rising(cls, interval: Interval) -> Interval:
        low, high = interval
        if not 0 < low <= high:
            raise ValueError(f"[{low:g}, {high:g}] must be positive and rise; write the smaller value first")
        return interval
