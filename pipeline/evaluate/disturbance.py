"""What a trial under a distribution of conditions draws from its seed, and how it changes objects, physics and beliefs.

The robot plans with what it believes: where it believes the objects to be, and the joint angles that it measures.
Physics has the truth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.records.parameters.conditions import DistributionParameters, overridden
from pipeline.records.parameters.physics import PhysicsParameters, friction_of_all_contacts
from pipeline.records.tables import DRAWN
from pipeline.stages.seeds import item_generator

Vectors = NDArray[np.float64]


@dataclass(frozen=True)
class Disturbance:
    """The draw of one trial with n objects and R joints; see ``records.tables.DRAWN``."""

    friction: float
    torque_limit: float  # N m
    latency: int  # control periods
    joint_errors: Vectors  # (R,) rad
    mass_factors: Vectors  # (n,)
    centre_offsets: Vectors  # (n, 3) m, object frames
    position_errors: Vectors  # (n, 3) m, world frame
    rotation_errors: Vectors  # (n, 3) rad, rotation vectors, world frame
    shoves: Vectors  # (n, 3) N, world frame
    shove_seconds: float

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


def draw(ranges: DistributionParameters, seed: int, count: int, joints: int) -> Disturbance:
    """Return what a trial draws.

    Every quantity has a generator of its own, so that with another range it is stretched and the others stay.

    Args:
        seed: of the trial.
        count: of objects.
        joints: of the whole robot.
    """

    def rng(quantity: str) -> np.random.Generator:
        return item_generator(seed, "distribution", quantity)

    # Length or angle is uniform from 0 to the maximum, but for the centre of mass, which is uniform in a ball.
    offsets = rng("centre_offset").uniform(size=(count, 1)) ** (1 / 3) * _directions(count, rng("centre_direction"))
    angles = rng("position_direction").uniform(0.0, 2 * np.pi, count)
    level = np.stack([np.cos(angles), np.sin(angles), np.zeros(count)], axis=1)
    low, high = np.log(ranges.mass_factor)
    return Disturbance(
        friction=float(rng("friction").uniform(*ranges.friction)),
        torque_limit=float(rng("torque_limit").uniform(*ranges.torque_limit)),
        latency=int(rng("latency").integers(ranges.latency + 1)),
        joint_errors=ranges.joint_error * rng("joint_error").uniform(-1.0, 1.0, joints),
        mass_factors=np.exp(low + (high - low) * rng("mass_factor").uniform(size=count)),
        centre_offsets=ranges.centre_offset * offsets,
        position_errors=ranges.position_error * rng("position_error").uniform(size=(count, 1)) * level,
        rotation_errors=ranges.rotation_error
        * rng("rotation_error").uniform(size=(count, 1))
        * _directions(count, rng("rotation_axis")),
        shoves=ranges.shove_force * rng("shove").uniform(size=(count, 1)) * _directions(count, rng("shove_direction")),
        shove_seconds=ranges.shove_seconds,
    )


def _directions(count: int, rng: np.random.Generator) -> Vectors:
    """Return unit vectors (count, 3), uniform on the sphere."""
    vectors = rng.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


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
