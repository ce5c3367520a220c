"""Rigid bodies in MuJoCo: objects from their prepared convex parts, boxes, and boxes that are carried."""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.physics.mujoco_contacts import Surface
from pipeline.physics.mujoco_simulation import Simulation
from pipeline.records.objects import PreparedObject
from pipeline.records.poses import pose_matrix, position_quaternion

CARRIER_MASS = 1e5  # kg: 100 N for a physics step of 5 ms move it by 1e-8 m


@dataclass(frozen=True)
class MujocoBody:
    """A rigid body; see :class:`pipeline.physics.engine.Body`."""

    name: str
    simulation: Simulation
    link_names: dict[str, str]  # of all robots of the world, by the name of the body

    @property
    def pose(self) -> NDArray[np.float64]:
        """``T_world_body`` (4, 4)."""
        if self.simulation.diverged:
            return np.full((4, 4), np.nan)
        model, data = self.simulation.model, self.simulation.data
        body = model.body(self.name)
        if not body.jntnum[0]:
            return pose_matrix(body.pos, body.quat)
        where = model.jnt_qposadr[body.jntadr[0]]
        return pose_matrix(data.qpos[where : where + 3], data.qpos[where + 3 : where + 7])

    def link_impulses(self) -> dict[str, NDArray[np.float64]]:
        """Return the impulse (3,), N s, world frame, from each touching link in the last step."""
        impulses = self.simulation.impulses_on(self.name)
        return {self.link_names[name]: impulse for name, impulse in impulses.items() if name in self.link_names}

    def push(self, force: ArrayLike) -> None:
        """Apply ``force`` (3,), N, world frame, at the centre of mass during the next step."""
        self.simulation.push(self.name, force)

    @property
    def velocities(self) -> slice:
        """Where a free body's six velocities are among those of the model."""
        first = self.simulation.model.body(self.name).dofadr[0]
        return slice(first, first + 6)


@dataclass(frozen=True)
class MujocoCarrier(MujocoBody):
    """A box on three sliding joints, too heavy for anything to move; see :class:`pipeline.physics.engine.Carrier`."""

    position: NDArray[np.float64]  # (3,) m, where it is
    target: NDArray[np.float64] = field(default_factory=lambda: np.full(3, np.nan))  # (3,) m, not a number: none

    @property
    def pose(self) -> NDArray[np.float64]:
        """``T_world_body`` (4, 4)."""
        return pose_matrix(self.position, [1.0, 0.0, 0.0, 0.0])

    def carry_to(self, position: ArrayLike) -> None:
        """Move to ``position`` (3,), m, during the next step."""
        self.target[:] = position

    def set_off(self) -> None:
        """Give it the velocity with which it arrives in the coming step."""
        model, data = self.simulation.model, self.simulation.data
        first = model.body(self.name).dofadr[0]
        away = np.zeros(3) if np.isnan(self.target).any() else self.target - self.position
        data.qvel[first : first + 3] = away * self.simulation.settings.frequency

    def arrive(self) -> None:
        """Put it exactly where the step was to bring it."""
        model, data = self.simulation.model, self.simulation.data
        body = model.body(self.name)
        if not np.isnan(self.target).any():
            self.position[:] = self.target
            self.target[:] = np.nan
        where = model.jnt_qposadr[body.jntadr[0]]
        data.qpos[where : where + 3] = self.position - body.pos
        data.qvel[body.dofadr[0] : body.dofadr[0] + 3] = 0.0


def add_free_body(simulation: Simulation, prepared: PreparedObject, T_world_object: ArrayLike, name: str) -> None:
    """Add an object that moves freely."""
    position, quaternion = position_quaternion(T_world_object)
    inertia = prepared.inertia
    body = simulation.spec.worldbody.add_body(
        name=name,
        pos=position,
        quat=quaternion,
        mass=prepared.mass,
        ipos=[0.0, 0.0, 0.0],
        fullinertia=[*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]],
        explicitinertial=True,
    )
    body.add_freejoint()
    for index, (vertices, _) in enumerate(prepared.parts):
        part = f"{name}:{index}"
        simulation.spec.add_mesh(
            name=part,
            uservert=np.asarray(vertices, np.float64).ravel(),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX,
        )
        body.add_geom(name=part, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=part, contype=0, conaffinity=0)
        friction = simulation.settings.object_friction
        simulation.surfaces.append(Surface(part, name, friction, patch_radius=0.0, fixed=False))


def add_box(simulation: Simulation, half_size: ArrayLike, T_world_box: ArrayLike, name: str, slides: bool) -> None:
    """Add a box that no force moves, ``half_size`` (3,), m; with ``slides`` it has joints along the world's axes."""
    position, quaternion = position_quaternion(T_world_box)
    body = simulation.spec.worldbody.add_body(name=name, pos=position, quat=quaternion)
    if slides:
        body.mass, body.inertia, body.explicitinertial = CARRIER_MASS, np.full(3, CARRIER_MASS), True
        body.gravcomp = 1.0
        for axis in np.eye(3):
            body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    body.add_geom(
        name=name, type=mujoco.mjtGeom.mjGEOM_BOX, size=np.asarray(half_size, np.float64), contype=0, conaffinity=0
    )
    friction = simulation.settings.support_friction
    simulation.surfaces.append(Surface(name, name, friction, patch_radius=0.0, fixed=True))
