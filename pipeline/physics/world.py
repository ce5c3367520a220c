"""An empty PhysX world on the CPU, without a renderer.

SAPIEN takes scene, body and shape settings from process-wide configurations at construction, so every world sets all
of them. Gravity cannot change afterwards: another direction needs another world. A world is to be used for one test
only: bodies that share a scene influence each other's last bits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.records.parameters.physics import PhysicsParameters

GRAVITY = 9.81  # m/s2
# ManiSkill's values, which the paper's code keeps.
BOUNCE_THRESHOLD = 2.0  # m/s
SLEEP_THRESHOLD = 0.005  # m2/s2, kinetic energy by mass
VELOCITY_ITERATIONS = 1


@dataclass(frozen=True)
class World:
    """A scene, its CPU physics system, and the settings it was made with."""

    scene: Any  # sapien.Scene
    system: Any  # sapien.physx.PhysxCpuSystem
    settings: PhysicsParameters

    def step(self, count: int = 1) -> None:
        """Advance by ``count`` physics steps of ``1 / settings.frequency`` seconds."""
        for _ in range(count):
            self.system.step()

    def steps(self, seconds: float) -> int:
        """Return the number of physics steps in ``seconds``, at least 1."""
        return max(1, round(seconds * self.settings.frequency))


def configure(settings: PhysicsParameters, gravity: ArrayLike) -> None:
    """Give the next PhysX system of this process its settings and ``gravity`` (3,), m/s2, world frame."""
    from sapien import physx

    physx.set_shape_config(contact_offset=settings.contact_offset, rest_offset=0.0)
    physx.set_body_config(
        solver_position_iterations=settings.position_iterations,
        solver_velocity_iterations=VELOCITY_ITERATIONS,
        sleep_threshold=SLEEP_THRESHOLD,
    )
    physx.set_scene_config(
        gravity=np.asarray(gravity, dtype=np.float32),
        bounce_threshold=BOUNCE_THRESHOLD,
        enable_pcm=True,
        enable_tgs=True,
        enable_ccd=False,
        enable_enhanced_determinism=False,
        enable_friction_every_iteration=True,
        cpu_workers=0,
    )


def make_world(settings: PhysicsParameters, gravity: ArrayLike = (0.0, 0.0, -GRAVITY)) -> World:
    """Return an empty world with constant ``gravity`` (3,), m/s2, world frame."""
    import sapien
    from sapien import physx

    configure(settings, gravity)
    system = physx.PhysxCpuSystem()
    system.timestep = 1.0 / settings.frequency
    return World(scene=sapien.Scene([system]), system=system, settings=settings)


def to_sapien(T: ArrayLike) -> Any:
    """Return a ``sapien.Pose`` from a transform (4, 4)."""
    import sapien

    from pipeline.records.poses import position_quaternion

    position, quaternion = position_quaternion(T)
    return sapien.Pose(position, quaternion)


def from_sapien(pose: Any) -> NDArray[np.float64]:
    """Return a transform (4, 4) from a ``sapien.Pose`` (single precision)."""
    from pipeline.records.poses import pose_matrix

    return pose_matrix(np.asarray(pose.p, np.float64), np.asarray(pose.q, np.float64))
