"""What a trial under a distribution of conditions draws from its seed, and how it changes objects, physics and beliefs.

The robot plans with what it believes: where it believes the objects to be, and the joint angles that it measures.
Physics has the truth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.records.parameters.conditions import DistributionParameters, overridden
from pipeline.records.parameters.physics import PhysicsParameters, friction_of_all_contacts
from pipeline.records.tables import DRAWN
from pipeline.robustness.disturbance import Disturbance, Vectors, draw_disturbance
from pipeline.stages.seeds import item_generator


@dataclass(frozen=True)
class TrialDisturbance(Disturbance):
    """The draw of one trial with n objects and R joints, world frame; see ``records.tables.DRAWN``."""

    shove_seconds: float
    latency: int  # control periods
    joint_errors: Vectors  # (R,) rad

    def physics(self, standard: PhysicsParameters) -> PhysicsParameters:
        """Return the physics of the trial."""
        drawn = friction_of_all_contacts(self.friction) | {"hand_torque_limit": self.torque_limit}
        return overridden(standard, drawn)

    def columns(self) -> dict[str, Any]:
        """Return the columns ``DRAWN`` of the trial's row."""
        return {name: _plain(getattr(self, name)) for name in DRAWN.names}


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


def undrawn() -> dict[str, None]:
    """Return the columns ``DRAWN`` of a trial that draws nothing."""
    return dict.fromkeys(DRAWN.names)


def draw(ranges: DistributionParameters, seed: int, count: int, joints: int) -> TrialDisturbance:
    """Return what a trial draws.

    Args:
        seed: of the trial.
        count: of objects.
        joints: of the whole robot.
    """
    return TrialDisturbance(
        **vars(draw_disturbance(ranges, seed, count, level=True)),
        shove_seconds=ranges.shove_seconds,
        latency=int(item_generator(seed, "latency").integers(ranges.latency + 1)),
        joint_errors=ranges.joint_error * item_generator(seed, "joint error").uniform(-1.0, 1.0, joints),
    )


def believed_pose(
    T_world_object: Vectors, position_error: Vectors, rotation_error: Vectors, resting: Vectors | None = None
) -> Vectors:
    """Return the pose (4, 4) that the robot believes an object to have.

    Args:
        position_error: (3,) m, world frame.
        rotation_error: (3,) rad, rotation vector about the object's origin, world frame.
        resting: (V, 3) vertices of an object that rests on something: the height of its lowest vertex is known.
    """
    T = T_world_object.copy()
    T[:3, :3] = Rotation.from_rotvec(rotation_error).as_matrix() @ T_world_object[:3, :3]
    T[:3, 3] += position_error
    if resting is not None:
        T[2, 3] += (resting @ T_world_object[2, :3]).min() - (resting @ T[2, :3]).min()
    return T
