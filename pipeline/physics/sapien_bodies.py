"""Rigid bodies in SAPIEN: objects from their prepared convex parts, and boxes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import sapien
from numpy.typing import ArrayLike, NDArray
from sapien import physx

from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.poses import pose_matrix, position_quaternion


def to_sapien(T: ArrayLike) -> Any:
    """Return a ``sapien.Pose`` from a transform (4, 4)."""
    return sapien.Pose(*position_quaternion(T))


def from_sapien(pose: Any) -> NDArray[np.float64]:
    """Return a transform (4, 4) from a ``sapien.Pose`` (single precision)."""
    return pose_matrix(np.asarray(pose.p, np.float64), np.asarray(pose.q, np.float64))


@dataclass(frozen=True)
class SapienBody:
    """A rigid body; see :class:`pipeline.physics.engine.Body` and :class:`pipeline.physics.engine.Carrier`."""

    component: Any  # sapien.physx.PhysxRigidDynamicComponent or ...StaticComponent
    system: Any  # sapien.physx.PhysxCpuSystem
    link_names: dict[Any, str]  # of all robots of the world, by component

    @property
    def pose(self) -> NDArray[np.float64]:
        """``T_world_body`` (4, 4)."""
        return from_sapien(self.component.entity_pose)

    @property
    def asleep(self) -> bool:
        """PhysX has put the body to rest; it stays where it is until something wakes it."""
        return bool(self.component.is_sleeping)

    def carry_to(self, position: ArrayLike) -> None:
        """Move a kinematic body that is not turned to ``position`` (3,), m, during the next step."""
        self.component.kinematic_target = sapien.Pose(position)

    def push(self, force: ArrayLike) -> None:
        """Apply ``force`` (3,), N, world frame, at the centre of mass during the next step; PhysX then forgets it."""
        self.component.add_force_torque(np.asarray(force, np.float32), np.zeros(3, np.float32), "force")

    def link_impulses(self) -> dict[str, NDArray[np.float64]]:
        """Return the impulse (3,), N s, world frame, from each touching link; while all sleeps the last ones stay."""
        total: dict[str, NDArray[np.float64]] = {}
        for contact in self.system.get_contacts():
            first, second = contact.bodies
            if first == self.component and second in self.link_names:
                name, sign = self.link_names[second], 1.0
            elif second == self.component and first in self.link_names:
                name, sign = self.link_names[first], -1.0
            else:
                continue
            impulse = sign * np.sum([point.impulse for point in contact.points], axis=0, dtype=np.float64)
            if np.any(impulse):
                total[name] = total.get(name, np.zeros(3)) + impulse
        return total


def free_component(prepared: PreparedObject, settings: PhysicsParameters) -> Any:
    """Return an object that moves freely as a ``PhysxRigidDynamicComponent``."""
    material = physx.PhysxMaterial(settings.object_friction, settings.object_friction, 0.0)
    component = physx.PhysxRigidDynamicComponent()
    for vertices, _ in prepared.parts:
        component.attach(
            physx.PhysxCollisionShapeConvexMesh(
                vertices=np.asarray(vertices, dtype=np.float32), scale=[1, 1, 1], material=material
            )
        )
    _set_inertia(component, prepared.mass, prepared.inertia)
    return component


def _set_inertia(component: Any, mass: float, inertia: NDArray[np.float64]) -> None:
    """Set mass and inertia (3, 3) about the body's origin, which is its centre of mass."""
    moments, axes = np.linalg.eigh(inertia)
    if np.linalg.det(axes) < 0:
        axes[:, 2] = -axes[:, 2]
    principal = np.eye(4)
    principal[:3, :3] = axes
    component.mass = mass
    component.cmass_local_pose = to_sapien(principal)
    component.inertia = moments.astype(np.float32)


def box_component(component: Any, half_size: ArrayLike, settings: PhysicsParameters) -> Any:
    """Return a static or kinematic component with the shape of a box, ``half_size`` (3,), m."""
    material = physx.PhysxMaterial(settings.support_friction, settings.support_friction, 0.0)
    component.attach(physx.PhysxCollisionShapeBox(half_size=np.asarray(half_size, np.float32), material=material))
    return component


def place(scene: Any, component: Any, T_world_body: ArrayLike, name: str) -> None:
    """Put a component into a scene."""
    component.name = name
    entity = sapien.Entity()
    entity.name = name
    entity.add_component(component)
    entity.pose = to_sapien(T_world_body)
    scene.add_entity(entity)
