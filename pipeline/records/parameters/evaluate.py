"""`evaluate`: trials of the whole sequence with a simulated Panda arm and Allegro hand."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from pipeline.records.parameters.section import Section


class EvaluateParameters(Section):
    """Scene, motion and success criterion of a trial."""

    trials: int = Field(25, ge=1, le=1000, description="Trials per pair. Paper: 25.")
    least_room: float = Field(
        0.002,
        ge=0,
        le=0.05,
        description="[m] Smallest clearance, of the objects from each other and from links that do not hold them, of "
        "grasps that are tried before all others. Of these, the most robust are tried first. Paper: grasps are drawn.",
    )
    object_distance: float = Field(
        0.2, gt=0.1, le=0.5, description="[m] Distance between the two objects on the sponge. Paper: 0.2."
    )
    perturbation: float = Field(
        0.005,
        ge=0,
        le=0.05,
        description="[m] Maximum offset of each object in x and in y, drawn uniformly to either side. Paper's code: "
        "0.005.",
    )
    yaw_perturbation: float = Field(
        0.0,
        ge=0,
        le=3.2,
        description="[rad] Maximum rotation of each object about the vertical, drawn uniformly to either side. Paper's "
        "code: 0.",
    )
    sponge_height: float = Field(
        0.1, gt=0, le=0.3, description="[m] Height of the sponge that the objects stand on. Paper's code: 0.1."
    )
    lift_height: float = Field(
        0.22,
        gt=0,
        le=0.4,
        description="[m] Commanded height of the last lift; it must exceed success_height because the arm sags. Paper: "
        "0.2.",
    )
    first_lift_height: float = Field(
        0.1, gt=0, le=0.4, description="[m] Height of the lift with object 0 alone. Paper's code: 0.1."
    )
    success_height: float = Field(
        0.2,
        gt=0,
        le=0.4,
        description="[m] Minimum height of both objects above where they rested for a trial to succeed. Paper: 0.2.",
    )
    hold_seconds: float = Field(
        2.0, gt=0, le=20, description="[s] How long both objects must be held after the last lift. Paper: 2."
    )
    control_frequency: int = Field(
        50, ge=10, le=200, description="[Hz] Joint targets sent per second. Paper's code: 20-50."
    )
    close_seconds: float = Field(1.0, gt=0, le=5, description="[s] Time for the fingers to close. Paper's code: 1.")
    dwell_seconds: float = Field(
        0.3, ge=0, le=5, description="[s] Pause after the fingers have closed, before the arm lifts."
    )
    planning_attempts: int = Field(
        4, ge=1, le=20, description="Maximum number of grasps for which a motion is sought in a trial. Paper's code: 1."
    )
    settle_seconds: float = Field(
        0.5, ge=0, le=5, description="[s] Time for the objects to settle before the robot moves. Paper's code: 1."
    )
    open_seconds: float = Field(0.5, gt=0, le=5, description="[s] Time for the fingers to open. Paper's code: 1.")
    entry_length: float = Field(
        0.05, gt=0, le=0.3, description="[m] Length of the straight approach to object 0. Paper: 0.05."
    )
    shorter_entries: list[Annotated[float, Field(gt=0, le=0.5)]] = Field(
        [0.12, 0.07],
        description="[m] Shorter lengths of the straight approach to object 1, tried in this order if no motion is "
        "found with the grasp's own.",
    )
    planner: Literal["own", "curobo"] = Field(
        "own",
        description="Planner of the arm's moves to a pre-grasp: `own`, or `curobo` where cuRobo 2 is installed; the "
        "latter is not tested on a GPU, and its trials may not repeat to the bit. Paper's code: on the GPU.",
    )
    planning_margin: float = Field(
        0.003,
        ge=0,
        le=0.05,
        description="[m] Clearance kept from obstacles in planning; dropped if no motion is found with it.",
    )
    push_limit: float = Field(
        0.02,
        gt=0,
        le=0.2,
        description="[m] Maximum motion of an object before its fingers close; a trial that exceeds it fails.",
    )

    @model_validator(mode="after")
    def _lift_can_succeed(self) -> EvaluateParameters:
        if self.lift_height <= self.success_height:
            raise ValueError("lift_height must exceed success_height, or no trial could succeed; raise it")
        return self
