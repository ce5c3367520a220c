"""MuJoCo as the physics engine.

A contact in MuJoCo is a spring, so what begins in an overlap is thrown out of it, and a light object between fingers
that begin to squeeze with all their torque gets a kick. A squeeze therefore begins gently; see
:meth:`MujocoWorld.squeeze`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import ArrayLike

from pipeline.hand.model import Hand
from pipeline.physics.engine import Robot, steps_in
from pipeline.physics.mujoco_bodies import MujocoBody, MujocoCarrier, add_box, add_free_body
from pipeline.physics.mujoco_robots import MujocoRobot, add_robot
from pipeline.physics.mujoco_simulation import Simulation
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.physics import PhysicsParameters

# s; in it an object that nothing touches loses 63 % of its speed while a squeeze begins. Thrown out of an overlap by a
# contact with time constant T it has at most overlap / (e T), so it comes to rest within the overlap once more.
CALM_SECONDS = 0.01

# Contacts creep, so that nothing ever stands still. What has been slower than this for so long moves less than half of
# what a test of holding allows in the rest of it.
REST_SPEED = 0.004  # m/s
REST_TURN = 0.1  # rad/s, of objects and of a hand's joints
REST_SECONDS = 0.4  # as PhysX waits


class MujocoWorld:
    """A MuJoCo model and its state; see :class:`pipeline.physics.engine.World` for what it does.

    It is built when it is first stepped or read, and takes nothing more after that.
    """

    def __init__(self, settings: PhysicsParameters, gravity: ArrayLike) -> None:
        """Make an empty world with ``gravity`` (3,), m/s2, world frame."""
        self.settings = settings
        self.robots: list[MujocoRobot] = []
        self.objects: list[MujocoBody] = []
        self.simulation = Simulation(settings, gravity)
        self._carriers: list[MujocoCarrier] = []
        self._link_names: dict[str, str] = {}  # by body
        self._resting = 0  # steps

    @property
    def frequency(self) -> int:
        """Physics steps per second."""
        return self.settings.frequency

    @property
    def asleep(self) -> bool:
        """Whether everything has been at rest for ``REST_SECONDS``, but for the creep of contacts."""
        return self._resting >= steps_in(REST_SECONDS, self.frequency)

    def step(self, count: int = 1) -> None:
        """Advance by ``count`` steps."""
        self._advance(count, watched=True)
        self._resting = self._resting + count if self._is_slow() else 0

    def _is_slow(self) -> bool:
        speeds = self.simulation.data.qvel
        along = [speeds[body.velocities][:3] for body in self.objects]
        return bool(
            np.abs(speeds).max(initial=0.0) < REST_TURN
            and all(np.linalg.norm(velocity) < REST_SPEED for velocity in along)
        )

    def _advance(self, count: int, watched: bool) -> None:
        for robot in self.robots:
            robot.drive()
        if not self._carriers:
            self.simulation.step(count, watched)
            return
        for left in reversed(range(count)):
            for carrier in self._carriers:
                carrier.set_off()
            self.simulation.step(1, watched and not left)
            for carrier in self._carriers:
                carrier.arrive()

    def squeeze(self, robot: Robot, q: ArrayLike) -> None:
        """Move the targets to ``q`` (n,), rad, in ``squeeze_seconds``, without gravity, the objects strongly damped."""
        begin, end = robot.q, np.asarray(q, np.float64)
        steps = steps_in(self.settings.mujoco.squeeze_seconds, self.frequency)
        with self._calm():
            for step in range(1, steps + 1):
                robot.set_targets(begin + step / steps * (end - begin))
                self._advance(1, watched=step == steps)

    @contextmanager
    def _calm(self) -> Iterator[None]:
        """Take gravity away, and the objects' speed within ``CALM_SECONDS``."""
        model = self.simulation.model
        gravity = model.opt.gravity.copy()
        model.opt.gravity[:] = 0.0
        for body in self.objects:
            own = body.velocities
            mass, inertia = model.body(body.name).mass, model.body(body.name).inertia
            model.dof_damping[own] = np.concatenate([np.repeat(mass, 3), np.repeat(inertia.max(), 3)]) / CALM_SECONDS
        yield
        model.opt.gravity[:] = gravity
        for body in self.objects:
            model.dof_damping[body.velocities] = 0.0

    def add_hand(self, hand: Hand, T_world_hand: ArrayLike, q: ArrayLike) -> MujocoRobot:
        """Add a hand alone, root link at ``T_world_hand`` (4, 4), at rest at ``q`` (J,), rad."""
        return self._add_robot(False, T_world_hand, hand, q)

    def add_arm(self, hand: Hand, q: ArrayLike) -> MujocoRobot:
        """Add a hand on the arm, ``panda_link0`` at the world's origin, at rest at ``q`` (n,), rad."""
        return self._add_robot(True, np.eye(4), hand, q)

    def _add_robot(self, arm: bool, T_world_root: ArrayLike, hand: Hand, q: ArrayLike) -> MujocoRobot:
        prefix = f"robot{len(self.robots)}/"
        robot = add_robot(self.simulation, arm, T_world_root, hand, q, prefix)
        self.robots.append(robot)
        links = {body.name for body in self.simulation.spec.bodies if body.name.startswith(prefix)}
        self._link_names.update({link: link.removeprefix(prefix) for link in links})
        return robot

    def add_object(self, prepared: PreparedObject, T_world_object: ArrayLike, name: str) -> MujocoBody:
        """Add an object at ``T_world_object`` (4, 4)."""
        add_free_body(self.simulation, prepared, T_world_object, name)
        self.objects.append(MujocoBody(name, self.simulation, self._link_names))
        return self.objects[-1]

    def add_box(self, half_size: ArrayLike, T_world_box: ArrayLike, name: str) -> MujocoBody:
        """Add a fixed box, ``half_size`` (3,), its centre at ``T_world_box`` (4, 4)."""
        add_box(self.simulation, half_size, T_world_box, name, slides=False)
        return MujocoBody(name, self.simulation, self._link_names)

    def add_carrier(self, half_size: ArrayLike, T_world_box: ArrayLike, name: str) -> MujocoCarrier:
        """Add a box that moves by :meth:`MujocoCarrier.carry_to`."""
        add_box(self.simulation, half_size, T_world_box, name, slides=True)
        position = np.array(T_world_box, np.float64)[:3, 3]
        self._carriers.append(MujocoCarrier(name, self.simulation, self._link_names, position))
        return self._carriers[-1]
