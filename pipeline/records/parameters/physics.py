"""`physics`: the simulated world, shared by validate, merge and evaluate."""

from __future__ import annotations

from pydantic import Field

from pipeline.records.parameters.section import Section


def friction_of_all_contacts(friction: float) -> dict[str, float]:
    """Return the values of `physics` with which every two touching bodies have the same friction coefficient."""
    names = ("object_friction", "tip_static_friction", "tip_dynamic_friction", "link_friction", "support_friction")
    return dict.fromkeys(names, friction)


class PhysicsParameters(Section):
    """PhysX settings and materials; the frictions of two touching bodies are averaged."""

    frequency: int = Field(200, ge=50, le=2000, description="[Hz] Physics steps per second. Paper's code: 200.")
    position_iterations: int = Field(
        25, ge=1, le=255, description="Position iterations of the PhysX solver per step. Paper's code: 25."
    )
    contact_offset: float = Field(
        0.01,
        gt=0,
        le=0.1,
        description="[m] Distance at which PhysX starts to generate contacts, in trials; tests with a floating hand "
        "use validate.contact_offset. ManiSkill and paper's code: 0.02.",
    )
    object_friction: float = Field(0.9, ge=0, le=5, description="Friction coefficient of the objects. Paper: 0.9.")
    tip_static_friction: float = Field(
        2.0, ge=0, le=5, description="Static friction coefficient of the fingertips. ManiSkill: 2.0."
    )
    tip_dynamic_friction: float = Field(
        1.0, ge=0, le=5, description="Dynamic friction coefficient of the fingertips. ManiSkill: 1.0."
    )
    tip_patch_radius: float = Field(
        0.1,
        ge=0,
        le=1,
        description="[m] Radius of the contact patch that gives the fingertips torsional friction. ManiSkill: 0.1.",
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
