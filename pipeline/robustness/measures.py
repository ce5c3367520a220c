"""All measures of one grasp, as columns of its row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pipeline.physics.engine import torsional_friction
from pipeline.physics.holding import HeldGrasp
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.robustness import RobustnessParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.robustness.conditions import Condition, draw_conditions
from pipeline.robustness.contacts import GraspInHand, grip_contacts
from pipeline.robustness.friction import lowest_friction
from pipeline.robustness.margins import JointLimits, margins
from pipeline.robustness.survival import survived


@dataclass(frozen=True)
class Measuring:
    """What is measured of every grasp of an object or a pair."""

    settings: RobustnessParameters
    conditions: tuple[Condition, ...]  # of all grasps


def measuring(settings: RobustnessParameters, run_seed: int, *names: str) -> Measuring:
    """Return what is measured of the grasps of some objects, named in the order of picking."""
    return Measuring(settings, draw_conditions(settings, len(names), run_seed, *names))


def most_measured(own: Measuring | None) -> float:
    """Return how many merged grasps of a pair are measured; none where nothing is."""
    if own is None:
        return 0
    return np.inf if own.settings.merged_grasps is None else own.settings.merged_grasps


def margin_columns(
    grasp: GraspInHand, physics: PhysicsParameters, settings: RobustnessParameters
) -> list[dict[str, float | None]]:
    """Return the columns ``records.tables.MARGINS`` of every object's grip.

    Each as if the hand held nothing else: grips share no joint.
    """
    limits = JointLimits(grasp.hand.physical.together(physics), torsional_friction(1.0, physics.tip_patch_radius))
    found = [
        margins(grip_contacts(grip, grasp.q, grasp.hand), grip.held.prepared.mass, settings.friction, limits)
        for grip in grasp.grips
    ]
    return [{f"margin_{name}": _finite(value) for name, value in asdict(one).items()} for one in found]


def _finite(value: float) -> float | None:
    """Return a number, or None where it is infinite: no friction is enough."""
    return value if np.isfinite(value) else None


def physics_columns(
    grasp: GraspInHand, held: HeldGrasp, own: Measuring, physics: PhysicsParameters, limits: ValidateParameters
) -> dict[str, Any]:
    """Return the columns ``records.tables.ROBUSTNESS`` of a grasp, without those that the settings leave out.

    Args:
        held: the same grasp as the test of holding takes it.
    """
    columns: dict[str, Any] = {}
    if own.settings.ladder:
        columns["lowest_friction"] = _finite(lowest_friction(held, physics, limits, own.settings.ladder))
    if own.conditions:
        columns |= survived_share(survived(grasp, own.conditions, physics, limits, own.settings))
    return columns


def survived_share(outcomes: Sequence[bool]) -> dict[str, float]:
    """Return the share of conditions survived and its 95 % score interval (Wilson, 1927)."""
    from scipy.stats import binomtest

    interval = binomtest(sum(outcomes), len(outcomes)).proportion_ci(0.95, "wilson")
    return {
        "robustness": sum(outcomes) / len(outcomes),
        "robustness_low": float(interval.low),
        "robustness_high": float(interval.high),
    }
