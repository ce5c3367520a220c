"""Stiffness, damping and largest torque of every joint's drive, the same in both engines."""

from __future__ import annotations

from pipeline.hand.model import Hand
from pipeline.hand.robot import ARM_JOINT_NAMES
from pipeline.records.parameters.physics import PhysicsParameters


def drives(arm: bool, hand: Hand, settings: PhysicsParameters) -> list[tuple[float, float, float]]:
    """Return stiffness, damping and limit of all joints, in the order of ``hand.robot.all_joint_names``.

    N m/rad, N m s/rad and N m; N/m, N s/m and N of joints that slide.
    """
    of_arm = (settings.arm_stiffness, settings.arm_damping, settings.arm_torque_limit)
    of_hand = zip(*(values.tolist() for values in hand.physical.drives(settings)), strict=True)
    return [of_arm] * (len(ARM_JOINT_NAMES) if arm else 0) + list(of_hand)
