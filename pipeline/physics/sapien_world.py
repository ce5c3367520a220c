"""SAPIEN as the physics engine: PhysX on the CPU, without a renderer.

SAPIEN takes scene, body and shape settings from process-wide configurations at construction, so every world sets all
of them. Gravity cannot change afterwards: another direction needs another world. A world is to be used for one test
only: bodies that share a scene influence each other's last bits.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import sapien
from numpy.typing import ArrayLike
from sapien import physx

from pipeline.hand.model import Hand
from pipeline.physics.engine import Robot
from pipeline.physics.sapien_bodies import SapienBody, box_component, free_component, place
from pipeline.physics.sapien_robots import SapienRobot, build_robot
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.physics import PhysicsParameters

# ManiSkill's values, which the paper's code keeps.
BOUNCE_THRESHOLD = 2.0  # m/s
SLEEP_THRESHOLD = 0.005  # m2/s2, kinetic energy by mass
VELOCITY_ITERATIONS = 1


class SapienWorld:
    """A scene with its physics system; see :class:`pipeline.physics.engine.World` for what it does.

    Bodies know the system and the names of the links, not the world: a world that nobody uses is freed at once.
    """

    def __init__(self, settings: PhysicsParameters, system: Any) -> None:
        """Make an empty world in a PhysX system that was made with the same settings."""
        self.settings = settings
        self.system = system
        self.scene = sapien.Scene([system])
        self.robots: list[SapienRobot] = []
        self.objects: list[SapienBody] = []
        self._link_names: dict[Any, str] = {}  # by component

    @property
    def frequency(self) -> int:
        """Physics steps per second."""
        return self.settings.frequency

    @property
    def asleep(self) -> bool:
        """PhysX has put all robots and objects to rest; they stay where they are until something wakes them."""
        return all(robot.asleep for robot in self.robots) and all(body.asleep for body in self.objects)

    def step(self, count: int = 1) -> None:
        """Advance by ``count`` steps."""
        for _ in range(count):
            self.system.step()

    def squeeze(self, robot: Robot, q: ArrayLike) -> None:
        """Set drive targets ``q`` (n,), rad, at once."""
        robot.set_targets(q)

    def add_hand(self, hand: Hand, T_world_hand: ArrayLike, q: ArrayLike) -> SapienRobot:
        """Add a hand alone, root link at ``T_world_hand`` (4, 4), at rest at ``q`` (J,), rad."""
        return self._add_robot(build_robot(self.scene, self.settings, False, T_world_hand, hand), q)

    def add_arm(self, hand: Hand, q: ArrayLike) -> SapienRobot:
        """Add a hand on the arm, ``panda_link0`` at the world's origin, at rest at ``q`` (n,), rad."""
        return self._add_robot(build_robot(self.scene, self.settings, True, np.eye(4), hand), q)

    def _add_robot(self, robot: SapienRobot, q: ArrayLike) -> SapienRobot:
        robot.set_q(q)
        robot.set_targets(q)
        self.robots.append(robot)
        self._link_names.update({link: name for name, link in robot.links.items()})
        return robot

    def add_object(self, prepared: PreparedObject, T_world_object: ArrayLike, name: str) -> SapienBody:
        """Add an object at ``T_world_object`` (4, 4)."""
        body = self._add_body(free_component(prepared, self.settings), T_world_object, name)
        self.objects.append(body)
        return body

    def add_box(self, half_size: ArrayLike, T_world_box: ArrayLike, name: str) -> SapienBody:
        """Add a fixed box, ``half_size`` (3,), its centre at ``T_world_box`` (4, 4)."""
        component = box_component(physx.PhysxRigidStaticComponent(), half_size, self.settings)
        return self._add_body(component, T_world_box, name)

    def add_carrier(self, half_size: ArrayLike, T_world_box: ArrayLike, name: str) -> SapienBody:
        """Add a box that moves by :meth:`SapienBody.carry_to`, PhysX's kinematic body."""
        component = physx.PhysxRigidDynamicComponent()
        component.kinematic = True
        return self._add_body(box_component(component, half_size, self.settings), T_world_box, name)

    def _add_body(self, component: Any, T_world_body: ArrayLike, name: str) -> SapienBody:
        place(self.scene, component, T_world_body, name)
        return SapienBody(component, self.system, self._link_names)


def configure(settings: PhysicsParameters, gravity: ArrayLike) -> None:
    """Give the next PhysX system of this process its settings and ``gravity`` (3,), m/s2, world frame."""
    physx.set_shape_config(contact_offset=settings.sapien.contact_offset, rest_offset=0.0)
    physx.set_body_config(
        solver_position_iterations=settings.sapien.position_iterations,
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


def cpu_world(settings: PhysicsParameters, gravity: ArrayLike) -> SapienWorld:
    """Return an empty world on the CPU with ``gravity`` (3,), m/s2, world frame."""
    configure(settings, gravity)
    system = physx.PhysxCpuSystem()
    system.timestep = 1.0 / settings.frequency
    return SapienWorld(settings, system)
