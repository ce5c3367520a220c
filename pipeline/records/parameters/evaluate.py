"""`evaluate`: the whole sequence with a simulated Panda and Allegro."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from pipeline.records.parameters.section import Section


class EvaluateParameters(Section):
    """Scene, motion and success of a trial."""

    trials: int = Field(25, ge=1, le=1000, description="Trials per pair. Paper: 25.")
    object_distance: float = Field(0.2, gt=0.1, le=0.5, description="Between the objects, m. Paper: 0.2.")
    perturbation: float = Field(
        0.005, ge=0, le=0.05, description="Placement, uniform +- in x and y, m. Paper's code: 0.005."
    )
    yaw_perturbation: float = Field(0.0, ge=0, le=3.2, description="Placement, uniform +-, rad. Paper's code: 0.")
    sponge_height: float = Field(0.1, gt=0, le=0.3, description="m. Paper's code: 0.10.")
    lift_height: float = Field(
        0.22, gt=0, le=0.4, description="Commanded last lift, m; must exceed success_height for sag. Paper: 0.20."
    )
    first_lift_height: float = Field(0.1, gt=0, le=0.4, description="Lift of object 0 alone, m. Paper's code: 0.10.")
    success_height: float = Field(0.2, gt=0, le=0.4, description="Both objects above rest, m. Paper: 0.20.")
    hold_seconds: float = Field(2.0, gt=0, le=20, description="For this long. Paper: 2.")
    control_frequency: int = Field(50, ge=10, le=200, description="Joint targets per second. Paper's code: 20-50.")
    close_seconds: float = Field(1.0, gt=0, le=5, description="Closing of fingers. Paper's code: 1.")
    dwell_seconds: float = Field(0.3, ge=0, le=5, description="Rest after closing and before lifting.")
    planning_attempts: int = Field(4, ge=1, le=20, description="Grasps tried when no motion is found. Paper's code: 1.")
    settle_seconds: float = Field(0.5, ge=0, le=5, description="Rest before anything moves. Paper's code: 1.")
    open_seconds: float = Field(0.5, gt=0, le=5, description="Opening of fingers. Paper's code: 1.")
    entry_length: float = Field(0.05, gt=0, le=0.3, description="Straight last approach to object 0, m. Paper: 0.05.")
    shorter_entries: list[Annotated[float, Field(gt=0, le=0.5)]] = Field(
        [0.12, 0.07], description="Entry lengths to object 1 tried when the grasp's own is blocked, m."
    )
    planning_margin: float = Field(
        0.003, ge=0, le=0.05, description="Clearance asked of approaches, m; given up when nothing is found."
    )
    push_limit: float = Field(
        0.02, gt=0, le=0.2, description="Motion of an object before its fingers close that ends the trial, m."
    )

    @model_validator(mode="after")
    def _lift_can_succeed(self) -> EvaluateParameters:
        if self.lift_height <= self.success_height:
            raise ValueError("lift_height must be larger than success_height, or no trial can succeed")
        return self
