"""`physics`: the simulated world, shared by validate, merge and evaluate."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from pipeline.records.parameters.section import Section

TIP_RADIUS = 0.012  # m, of the Allegro's fingertips; a Hertz contact is smaller


def friction_of_all_contacts(friction: float) -> dict[str, float]:
    """Return the values of `physics` with which every two touching bodies have the same friction coefficient."""
    names = ("object_friction", "tip_static_friction", "tip_dynamic_friction", "link_friction", "support_friction")
    return dict.fromkeys(names, friction)


class SapienParameters(Section):
    """What SAPIEN (PhysX) alone needs to know."""

    position_iterations: int = Field(
        25, ge=1, le=255, description="Position iterations of the PhysX solver per step. Paper's code: 25."
    )
    contact_offset: float = Field(
        0.01,
        gt=0,
        le=0.1,
        description="[m] Distance at which PhysX starts to generate contacts, in trials; tests with a floating hand "
        "use validate.sapien_contact_offset. ManiSkill and paper's code: 0.02.",
    )


class MujocoParameters(Section):
    """What MuJoCo alone needs to know."""

    substeps: int = Field(5, ge=1, le=50, description="Time steps of MuJoCo per physics step.")
    joint_armature: float = Field(
        0.003,
        gt=0,
        le=1,
        description="[kg m2] Inertia of the motors, seen from the hand's joints. The Allegro's gears turn 369 times: "
        "about 0.003.",
    )
    friction_stiffness: float = Field(
        10.0,
        ge=1,
        le=1000,
        description="Ratio of the stiffness of friction to that of normal forces (MuJoCo's impratio). A higher one "
        "makes contacts that stick creep less.",
    )
    squeeze_seconds: float = Field(
        0.5,
        gt=0,
        le=5,
        description="[s] Time in which a hand that holds objects from the start begins to squeeze, before there is "
        "gravity.",
    )


class PhysicsParameters(Section):
    """Engine, materials and drives; the frictions of two touching bodies are averaged."""

    engine: Literal["sapien", "mujoco", "both"] = Field(
        "sapien",
        description="Physics engine. With `both`, a test of single or merged grasps is passed only in both; a trial "
        "runs in one, and refuses `both`. MuJoCo has one friction coefficient per contact, so it asks for "
        "tip_static_friction = tip_dynamic_friction. Paper: SAPIEN.",
    )
    frequency: int = Field(200, ge=50, le=2000, description="[Hz] Physics steps per second. Paper's code: 200.")
    sapien: SapienParameters = Field(SapienParameters.model_validate({}))
    mujoco: MujocoParameters = Field(MujocoParameters.model_validate({}))
    object_friction: float = Field(0.9, ge=0, le=5, description="Friction coefficient of the objects. Paper: 0.9.")
    tip_static_friction: float = Field(
        2.0, ge=0, le=5, description="Static friction coefficient of the fingertips. ManiSkill: 2.0."
    )
    tip_dynamic_friction: float = Field(
        1.0, ge=0, le=5, description="Dynamic friction coefficient of the fingertips. ManiSkill: 1.0."
    )
    tip_patch_radius: float = Field(
        0.005,
        ge=0,
        le=1,
        description="[m] Radius of the contact patch that gives the fingertips torsional friction: about that of soft "
        "rubber under some newtons. PhysX uses it only where shapes touch at one point. ManiSkill: 0.1.",
    )
    link_friction: float = Field(
        0.3, ge=0, le=5, description="Friction coefficient of all links but the fingertips. ManiSkill: 0.3."
    )
    support_friction: float = Field(
        0.5, ge=0, le=5, description="Friction coefficient of the sponge and the table. Paper's code: 0.5."
    )
    hand_stiffness: float = Field(
        400.0, gt=0, description="[N m/rad] Stiffness of the hand's joint drives. ManiSkill: 400."
    )
    hand_damping: float = Field(
        10.0, gt=0, description="[N m s/rad] Damping of the hand's joint drives. ManiSkill: 10."
    )
    hand_torque_limit: float = Field(
        0.7, gt=0, description="[N m] Torque limit of the hand's joints. Hardware: about 0.7. ManiSkill: 50."
    )
    arm_stiffness: float = Field(
        1000.0, gt=0, description="[N m/rad] Stiffness of the arm's joint drives. Paper's code: 1000."
    )
    arm_damping: float = Field(
        100.0, gt=0, description="[N m s/rad] Damping of the arm's joint drives. Paper's code: 100."
    )
    arm_torque_limit: float = Field(
        100.0, gt=0, description="[N m] Torque limit of the arm's joints. Paper's code: 100."
    )

    @property
    def engines(self) -> tuple[Literal["sapien", "mujoco"], ...]:
        """The engines in which a test has to be passed."""
        return ("sapien", "mujoco") if self.engine == "both" else (self.engine,)

    def in_engine(self, engine: Literal["sapien", "mujoco"]) -> PhysicsParameters:
        """Return the same physics in one engine."""
        return self.model_copy(update={"engine": engine})

    @model_validator(mode="after")
    def _mujoco_can_take_it(self) -> PhysicsParameters:
        if "mujoco" not in self.engines:
            return self
        if self.tip_static_friction != self.tip_dynamic_friction:
            raise ValueError(
                f"MuJoCo has one friction coefficient, but tip_static_friction is {self.tip_static_friction:g} and "
                f"tip_dynamic_friction {self.tip_dynamic_friction:g}; set both to the same value, or engine to sapien"
            )
        if self.tip_patch_radius > TIP_RADIUS:
            raise ValueError(
                f"MuJoCo takes tip_patch_radius as that of a Hertz contact, which is below the fingertip's "
                f"{TIP_RADIUS:g} m, not {self.tip_patch_radius:g}; lower it, or set engine to sapien"
            )
        return self
