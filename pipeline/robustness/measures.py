"""All measures of one grasp, as columns of its row."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from scipy.stats import binomtest

from pipeline.physics.holding import HeldGrasp
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.robustness import RobustnessParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.robustness.conditions import Condition
from pipeline.robustness.contacts import GraspInHand, grip_contacts
from pipeline.robustness.friction import lowest_friction
from pipeline.robustness.margins import JointLimits, Margins, margins
from pipeline.robustness.survival import survives


def grip_margins(grasp: GraspInHand, physics: PhysicsParameters, settings: RobustnessParameters) -> list[Margins]:
    """Return the margins of every object's grip, each as if the hand held nothing else: grips share no joint."""
    limits = JointLimits(physics.hand_torque_limit, settings.torsion_radius)
    return [
        margins(grip_contacts(grip, grasp.q, grasp.hand), grip.held.prepared.mass, settings.friction, limits)
        for grip in grasp.grips
    ]


def physics_measures(
    grasp: GraspInHand,
    held: HeldGrasp,
    conditions: Sequence[Condition],
    physics: PhysicsParameters,
    limits: ValidateParameters,
    settings: RobustnessParameters,
) -> dict[str, Any]:
    """Return the columns ``records.tables.HOLDING`` of a grasp; None where ``settings`` leave a measure out.

    Args:
        held: the same grasp as the test of holding takes it.
        conditions: those of its objects, see ``robustness.conditions``.
    """
    columns: dict[str, Any] = {}
    if settings.ladder:
        columns["lowest_friction"] = lowest_friction(held, physics, limits, settings.ladder)
    if conditions:
        survived = sum(survives(grasp, condition, physics, limits, settings) for condition in conditions)
        columns |= survived_share(survived, len(conditions))
    return columns


def survived_share(survived: int, conditions: int) -> dict[str, float]:
    """Return the share of conditions survived and its 95 % score interval (Wilson, 1927)."""
    interval = binomtest(survived, conditions).proportion_ci(0.95, "wilson")
    return {
        "robustness": survived / conditions,
        "robustness_low": float(interval.low),
        "robustness_high": float(interval.high),
    }
