"""`physics`: the simulated world, shared by validate, merge and evaluate."""

from __future__ import annotations

from pydantic import Field

from pipeline.records.parameters.section import Section


class PhysicsParameters(Section):
    """PhysX settings and materials; frictions of a touching pair are averaged."""

    frequency: int = Field(200, ge=50, le=2000, description="Physics steps per second. Paper's code: 200.")
    position_iterations: int = Field(25, ge=1, le=255, description="Solver iterations. Paper's code: 25.")
    contact_offset: float = Field(
        0.01,
        gt=0,
        le=0.1,
        description="m, in trials; validate has its own. ManiSkill's and the paper's: 0.02.",
    )
    object_friction: float = Field(0.9, ge=0, le=5, description="Paper: 0.9.")
    tip_static_friction: float = Field(2.0, ge=0, le=5, description="Fingertips. ManiSkill: 2.0.")
    tip_dynamic_friction: float = Field(1.0, ge=0, le=5, description="Fingertips. ManiSkill: 1.0.")
    tip_patch_radius: float = Field(0.1, ge=0, le=1, description="Torsional patch of fingertips, m. ManiSkill: 0.1.")
    link_friction: float = Field(0.3, ge=0, le=5, description="All other links. ManiSkill: 0.3.")
    support_friction: float = Field(0.5, ge=0, le=5, description="Sponge and table. Paper's code: 0.5.")
    hand_stiffness: float = Field(400.0, gt=0, description="N m/rad. ManiSkill: 400.")
    hand_damping: float = Field(10.0, gt=0, description="N m s/rad. ManiSkill: 10.")
    hand_torque_limit: float = Field(0.7, gt=0, description="N m. Hardware: about 0.7; ManiSkill: 50.")
    arm_stiffness: float = Field(1000.0, gt=0, description="N m/rad. Paper's code: 1000.")
    arm_damping: float = Field(100.0, gt=0, description="N m s/rad. Paper's code: 100.")
    arm_torque_limit: float = Field(100.0, gt=0, description="N m. Paper's code: 100.")
