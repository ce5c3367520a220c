"""A hand alone (floating, root fixed in space), or on the Panda arm, as bodies of a MuJoCo model.

MuJoCo reads the same URDF as SAPIEN, and takes the convex hull of every mesh. Joints are always addressed by name, in
the order of the hand.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import combinations
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.hand.model import Hand
from pipeline.hand.robot import all_joint_names, all_positions, robot_file, robot_joint_names
from pipeline.physics.drives import drives
from pipeline.physics.mujoco_contacts import IMPEDANCE, TIME_CONSTANT, Surface
from pipeline.physics.mujoco_simulation import Simulation
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.poses import pose_matrix, position_quaternion


@dataclass(frozen=True)
class MujocoRobot:
    """Links and joints of a model; see :class:`pipeline.physics.engine.Robot`."""

    simulation: Simulation
    prefix: str  # of its names in the model
    joint_names: tuple[str, ...]  # (n,) those that move by themselves
    motor_names: tuple[str, ...]  # (m,) first these, then those that follow them
    stiffness: NDArray[np.float64]  # (m,) N m/rad
    damping: NDArray[np.float64]  # (m,) N m s/rad
    targets: NDArray[np.float64]  # (2, m) of the drives: rad, rad/s
    all_positions: Callable[[ArrayLike], NDArray[np.float64]]  # from (n,) to (m,)

    @property
    def q(self) -> NDArray[np.float64]:
        """Joint positions (n,), rad."""
        if self.simulation.diverged:
            return np.full(len(self.joint_names), np.nan)
        return self.simulation.data.qpos[self._places].copy()

    @cached_property
    def _places(self) -> NDArray[np.int32]:
        """(n,) positions of the joints among those of the model."""
        model = self.simulation.model
        return np.array([model.joint(self.prefix + name).qposadr[0] for name in self.joint_names])

    @cached_property
    def _motors(self) -> NDArray[np.int32]:
        """(m,) positions of the motors among those of the model."""
        model = self.simulation.model
        return np.array([model.actuator(self.prefix + name).id for name in self.motor_names])

    def set_targets(self, q: ArrayLike, velocity: ArrayLike | None = None) -> None:
        """Set drive targets ``q`` (n,), rad, and target velocities (n,), rad/s (zero when left out)."""
        self.targets[0] = self.all_positions(q)
        self.targets[1] = 0.0
        if velocity is not None:
            self.targets[1] = self.all_positions(velocity) - self.all_positions(np.zeros(len(self.joint_names)))

    def drive(self) -> None:
        """Hand the targets to the motors, whose force is this less stiffness times q and damping times its rate."""
        self.simulation.data.ctrl[self._motors] = self.stiffness * self.targets[0] + self.damping * self.targets[1]

    def link_pose(self, name: str) -> NDArray[np.float64]:
        """``T_world_link`` (4, 4)."""
        if self.simulation.diverged:
            return np.full((4, 4), np.nan)
        model, data = self.simulation.model, self.simulation.data
        mujoco.mj_kinematics(model, data)
        body = data.body(self.prefix + name)
        return pose_matrix(body.xpos, body.xquat)


def add_robot(
    simulation: Simulation, arm: bool, T_world_root: ArrayLike, hand: Hand, q: ArrayLike, prefix: str
) -> MujocoRobot:
    """Add the hand, alone or on the arm, its root fixed in space; its links do not feel gravity.

    Args:
        arm: as in :func:`pipeline.physics.sapien_robots.build_robot`.
        T_world_root: (4, 4) pose of the root link.
        q: (n,) where the joints begin, rad.
        prefix: of all its names in the model.
    """
    settings = simulation.settings
    robot = mujoco.MjSpec.from_file(str(robot_file(arm, hand)))
    # Links stay bodies of their own where they are fixed to others, and some inertias of the description are such as no
    # body can have: they are put in their place after MuJoCo has changed them.
    robot.compiler.fusestatic = False
    robot.compiler.balanceinertia = True
    links = [body for body in robot.bodies if body.name != "world"]
    surfaces = [surface for link in links for surface in _surfaces(link, hand, settings, prefix)]
    names = all_joint_names(arm, hand)
    stiffness, damping = _add_drives(robot, names, arm, hand, settings)
    inertias = {prefix + link.name: np.array(link.fullinertia) for link in links if link.explicitinertial}
    never_meeting = _never_meeting(links, hand)
    for link in links:
        link.gravcomp = 1.0
    position, quaternion = position_quaternion(T_world_root)
    frame = simulation.spec.worldbody.add_frame(pos=position, quat=quaternion)
    simulation.spec.attach(robot, prefix=prefix, frame=frame)
    simulation.surfaces.extend(surfaces)
    simulation.never_meeting |= {frozenset(prefix + name for name in pair) for pair in never_meeting}
    place = partial(all_positions, arm, hand)
    start = np.array(place(q))
    targets = np.stack([start, np.zeros(len(start))])
    own = robot_joint_names(hand) if arm else hand.joint_names
    added = MujocoRobot(simulation, prefix, own, names, stiffness, damping, targets, place)
    simulation.corrections.append(partial(_set_inertias, inertias))
    simulation.beginnings.append(partial(_set_joints, dict(zip((prefix + name for name in names), start, strict=True))))
    return added


def _surfaces(link: Any, hand: Hand, settings: PhysicsParameters, prefix: str) -> list[Surface]:
    """Name the shapes of a link and return them."""
    tip = link.name in hand.tips
    friction = settings.tip_dynamic_friction if tip else settings.link_friction
    patch_radius = settings.tip_patch_radius if tip else 0.0
    found = []
    for index, geom in enumerate(link.geoms):
        geom.name = f"{link.name}:{index}"
        geom.contype = geom.conaffinity = 0
        fixed = not _moved_by(link)
        found.append(Surface(prefix + geom.name, prefix + link.name, friction, patch_radius, fixed))
    return found


def _moved_by(link: Any) -> str:
    """Return the name of the joint nearest to a link on the way to the root, '' for none."""
    while link.name != "world":
        if link.joints:
            return str(link.joints[0].name)
        link = link.parent
    return ""


def _never_meeting(links: list[Any], hand: Hand) -> set[tuple[str, str]]:
    """Return pairs of links that do not collide: those of the hand's groups, neighbours, and what one joint moves."""
    pairs = {pair for group in hand.never_meeting for pair in combinations(group, 2)}
    pairs |= {(link.name, link.parent.name) for link in links}
    moved_by = {link.name: _moved_by(link) for link in links}
    return pairs | {(a, b) for a, b in combinations(moved_by, 2) if moved_by[a] == moved_by[b]}


def _add_drives(
    robot: Any, names: tuple[str, ...], arm: bool, hand: Hand, settings: PhysicsParameters
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Add a motor to every joint; return stiffness and damping (n,) of each."""
    gains = []
    for name, (stiffness, damping, limit) in zip(names, drives(arm, hand, settings), strict=True):
        of_hand = name in hand.physical.names
        joint = robot.joint(name)
        joint.damping[:] = 0.0  # as the drives of the description, which are not used
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        joint.armature = settings.mujoco.joint_armature if of_hand else 0.0
        joint.solref_limit = [TIME_CONSTANT, 1.0]
        joint.solimp_limit = IMPEDANCE
        motor = robot.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.gaintype, motor.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
        motor.gainprm[0] = 1.0
        motor.biasprm[:3] = 0.0, -stiffness, -damping
        motor.forcelimited, motor.forcerange = mujoco.mjtLimited.mjLIMITED_TRUE, [-limit, limit]
        gains.append((stiffness, damping))
    return np.array(gains).T[0], np.array(gains).T[1]


def _set_joints(q: dict[str, float], model: Any, data: Any) -> None:
    for name, value in q.items():
        data.qpos[model.joint(name).qposadr[0]] = value


def _set_inertias(inertias: dict[str, NDArray[np.float64]], model: Any) -> None:
    """Give bodies the inertias of the description: xx, yy, zz, xy, xz, yz, kg m2, about the centre of mass."""
    for name, (xx, yy, zz, xy, xz, yz) in inertias.items():
        moments, axes = np.linalg.eigh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        turn = np.eye(4)
        turn[:3, :3] = axes * np.array([1.0, 1.0, np.linalg.det(axes)])
        model.body(name).inertia = moments
        model.body(name).iquat = position_quaternion(turn)[1]
