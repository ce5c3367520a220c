"""Rigid bodies of a world: objects from their prepared convex parts, and supports."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.physics.world import World, from_sapien, to_sapien
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.physics import PhysicsParameters


@dataclass(frozen=True)
class Body:
    """A rigid body; the body frame of an object is its prepared object frame, that of a support its centre."""

    name: str
    entity: Any  # sapien.Entity
    component: Any  # sapien.physx.PhysxRigidDynamicComponent or ...StaticComponent

    @property
    def pose(self) -> NDArray[np.float64]:
        """``T_world_body`` (4, 4)."""
        return from_sapien(self.component.entity_pose)

    def carry_to(self, position: ArrayLike) -> None:
        """Carry a kinematic body that is not turned to ``position`` (3,), m, during the next step.

        It moves with the velocity that this takes, so that what stands on it comes along.
        """
        import sapien

        self.component.kinematic_target = sapien.Pose(position)

    @property
    def asleep(self) -> bool:
        """PhysX has put the body to rest; it stays where it is until something wakes it."""
        return bool(self.component.is_sleeping)


def add_object(
    world: World,
    prepared: PreparedObject,
    settings: PhysicsParameters,
    T_world_object: ArrayLike,
    name: str | None = None,
) -> Body:
    """Add an object: its convex parts collide; mass and inertia are the prepared ones.

    Args:
        T_world_object: (4, 4) first pose.
        name: name of the body; the object's name when left out.
    """
    from sapien import physx

    material = physx.PhysxMaterial(settings.object_friction, settings.object_friction, 0.0)
    component = physx.PhysxRigidDynamicComponent()
    for vertices, _ in prepared.parts:
        component.attach(
            physx.PhysxCollisionShapeConvexMesh(
                vertices=np.asarray(vertices, dtype=np.float32), scale=[1, 1, 1], material=material
            )
        )
    _set_inertia(component, prepared.mass, prepared.inertia)
    return _add(world, component, T_world_object, name or prepared.name)


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


def add_support(
    world: World,
    settings: PhysicsParameters,
    half_size: ArrayLike,
    T_world_support: ArrayLike,
    kinematic: bool = True,
    name: str = "support",
) -> Body:
    """Add a box that things rest on; a kinematic one can be moved with :meth:`Body.carry_to`, otherwise it is static.

    Args:
        half_size: (3,) half extents, m.
        T_world_support: (4, 4) pose of the box's centre.
    """
    from sapien import physx

    material = physx.PhysxMaterial(settings.support_friction, settings.support_friction, 0.0)
    component = physx.PhysxRigidDynamicComponent() if kinematic else physx.PhysxRigidStaticComponent()
    if kinematic:
        component.kinematic = True
    component.attach(physx.PhysxCollisionShapeBox(half_size=np.asarray(half_size, np.float32), material=material))
    return _add(world, component, T_world_support, name)


def _add(world: World, component: Any, T: ArrayLike, name: str) -> Body:
    import sapien

    component.name = name
    entity = sapien.Entity()
    entity.name = name
    entity.add_component(component)
    entity.pose = to_sapien(T)
    world.scene.add_entity(entity)
    return Body(name=name, entity=entity, component=component)
