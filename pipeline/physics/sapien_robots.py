"""A hand alone (floating, root fixed in space), or on the Panda arm, as a SAPIEN articulation.

Joints are always addressed by name, in the order of the hand; SAPIEN's own order is breadth-first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sapien import physx
from sapien.wrapper.articulation_builder import ArticulationBuilder
from sapien.wrapper.urdf_loader import URDFLoader

from pipeline.hand.model import Hand
from pipeline.hand.robot import all_joint_names, all_positions, robot_file, robot_joint_names
from pipeline.physics.drives import drives
from pipeline.physics.sapien_bodies import from_sapien, to_sapien
from pipeline.records.parameters.physics import PhysicsParameters


@dataclass(frozen=True)
class SapienRobot:
    """An articulation with its joints in the order of ``joint_names``; see :class:`pipeline.physics.engine.Robot`."""

    articulation: Any  # sapien.physx.PhysxArticulation
    joint_names: tuple[str, ...]  # (n,) those that move by themselves
    joints: tuple[Any, ...]  # (m,) first these, then those that follow them
    order: NDArray[np.int64]  # (m,) position of each of them in SAPIEN's order
    all_positions: Callable[[ArrayLike], NDArray[np.float64]]  # from (n,) to (m,)
    links: dict[str, Any]  # components by name

    @property
    def q(self) -> NDArray[np.float64]:
        """Joint positions (n,), rad."""
        return np.asarray(self.articulation.qpos, np.float64)[self.order[: len(self.joint_names)]]

    def set_q(self, q: ArrayLike) -> None:
        """Put the joints at ``q`` (n,), rad, at once and at rest; drive targets stay as they are."""
        values = np.zeros(len(self.order), dtype=np.float32)
        values[self.order] = self.all_positions(q)
        self.articulation.qpos = values
        self.articulation.qvel = np.zeros_like(values)

    def set_targets(self, q: ArrayLike, velocity: ArrayLike | None = None) -> None:
        """Set drive targets ``q`` (n,), rad, and target velocities (n,), rad/s (zero when left out)."""
        positions, velocities = self.all_positions(q), np.zeros(len(self.joints))
        if velocity is not None:
            velocities = self.all_positions(velocity) - self.all_positions(np.zeros(len(self.joint_names)))
        for joint, position, speed in zip(self.joints, positions, velocities, strict=True):
            joint.set_drive_target(float(position))
            joint.set_drive_velocity_target(float(speed))

    def link_pose(self, name: str) -> NDArray[np.float64]:
        """``T_world_link`` (4, 4)."""
        return from_sapien(self.links[name].entity_pose)

    @property
    def asleep(self) -> bool:
        """PhysX has put the whole articulation to rest."""
        return bool(self.articulation.root.sleeping)


class _NoScene:
    """What the loader asks of a scene when the builder is to be kept."""

    def create_articulation_builder(self) -> Any:
        return ArticulationBuilder()


@lru_cache(maxsize=4)
def _parsed(arm: bool, hand: Hand) -> Any:
    """Parse the robot's URDF once per process; the builder is used again for every world."""
    loader = URDFLoader()
    loader.set_scene(_NoScene())
    builders, _, _ = loader.parse(str(robot_file(arm, hand)))
    builder = builders[0]
    for bit, group in enumerate(hand.never_meeting):
        for link in builder.link_builders:
            if link.name in group:
                link.collision_groups[2] |= 1 << bit
    return builder


def _materials(links: dict[str, Any], settings: PhysicsParameters, tips: frozenset[str]) -> None:
    tip = physx.PhysxMaterial(settings.tip_static_friction, settings.tip_dynamic_friction, 0.0)
    other = physx.PhysxMaterial(settings.link_friction, settings.link_friction, 0.0)
    for name, link in links.items():
        for shape in link.collision_shapes:
            shape.physical_material = tip if name in tips else other
            if name in tips:
                shape.patch_radius = settings.tip_patch_radius
                shape.min_patch_radius = settings.tip_patch_radius


def build_robot(scene: Any, settings: PhysicsParameters, arm: bool, T_world_root: ArrayLike, hand: Hand) -> SapienRobot:
    """Build the hand, alone or on the arm, in a scene, with a root fixed in space; its links do not feel gravity.

    Args:
        arm: False: J joints in the order of ``hand.joint_names``, root of the hand.
            True, for hands with a mount: 7 + J joints in the order of ``hand.robot.robot_joint_names``, root
            ``panda_link0``.
        T_world_root: (4, 4) pose of the root link.
    """
    builder = _parsed(arm, hand)
    builder.set_scene(scene)
    builder.set_initial_pose(to_sapien(T_world_root))
    articulation = builder.build(fix_root_link=True)
    names = all_joint_names(arm, hand)
    in_sapien = [joint.name for joint in articulation.active_joints]
    order = np.array([in_sapien.index(name) for name in names])
    joints = tuple(articulation.active_joints[index] for index in order)
    for joint, (stiffness, damping, limit) in zip(joints, drives(arm, hand, settings), strict=True):
        joint.set_drive_properties(stiffness, damping, limit)
    links = {link.name: link for link in articulation.links}
    for link in links.values():
        link.disable_gravity = True
    _materials(links, settings, hand.tips)
    own = robot_joint_names(hand) if arm else hand.joint_names
    return SapienRobot(articulation, own, joints, order, partial(all_positions, arm, hand), links)
