"""What tests and trials need of a physics engine, whichever it is.

Everything is in metres, kilograms, seconds and radians. ``T_a_b`` is the pose (4, 4) of frame b in frame a; the frame
of an object is that of its prepared mesh, the frame of a box is at its centre. A world is built, stepped, and serves
one test only. Building and stepping it in the same way must give the same numbers to the last bit.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.hand.model import Hand
from pipeline.records.objects import PreparedObject

GRAVITY = 9.81  # m/s2


class Body(Protocol):
    """A rigid body: an object, or a box that things stand on."""

    @property
    def pose(self) -> NDArray[np.float64]:
        """``T_world_body`` (4, 4) now; not finite once the simulation has diverged."""
        ...

    def link_impulses(self) -> dict[str, NDArray[np.float64]]:
        """Return the impulse (3,), N s, world frame, on the body from each touching robot link in the last step.

        The impulses of all contact points of a link are summed. Links that are near but do not press are left out.
        While the world is asleep they are those of the last step before.
        """
        ...

    def push(self, force: ArrayLike) -> None:
        """Apply ``force`` (3,), N, world frame, at the centre of mass of an object during the next step."""
        ...


class Carrier(Body, Protocol):
    """A box that moves as commanded and pushes aside or carries along what touches it."""

    def carry_to(self, position: ArrayLike) -> None:
        """Move the unturned box to ``position`` (3,), m, world frame, during the next step.

        It moves with the velocity that this takes, so that what stands on it comes along.
        """
        ...


class Robot(Protocol):
    """A hand, alone or on the arm, whose ``n`` joints follow targets by stiff, damped drives with limited torque."""

    @property
    def q(self) -> NDArray[np.float64]:
        """Joint positions (n,), rad, now, in the order in which they were given."""
        ...

    def set_targets(self, q: ArrayLike, velocity: ArrayLike | None = None) -> None:
        """Set drive targets ``q`` (n,), rad, and target velocities (n,), rad/s (zero when left out)."""
        ...

    def link_pose(self, name: str) -> NDArray[np.float64]:
        """Return ``T_world_link`` (4, 4) now."""
        ...


class World(Protocol):
    """A scene with constant gravity; friction, drives and contact settings are those of ``PhysicsParameters``."""

    @property
    def frequency(self) -> int:
        """Physics steps per second."""
        ...

    @property
    def asleep(self) -> bool:
        """Whether no robot and no object will move again by itself, but for creep that no test of holding notices."""
        ...

    def step(self, count: int = 1) -> None:
        """Advance by ``count`` steps."""
        ...

    def squeeze(self, robot: Robot, q: ArrayLike) -> None:
        """Set drive targets ``q`` (n,), rad, of a hand that was added with objects in its grasp; nothing moved yet.

        An engine in which a sudden squeeze would throw objects away brings the targets there gently, and without
        gravity, before this returns.
        """
        ...

    def add_hand(self, hand: Hand, T_world_hand: ArrayLike, q: ArrayLike) -> Robot:
        """Add a hand alone, its root fixed in space, at rest at ``q``, which are also its targets.

        The links of a robot do not feel gravity: the real arm compensates it.

        Args:
            T_world_hand: (4, 4) pose of the hand's root link.
            q: (J,) in the order of ``hand.joint_names``, rad.
        """
        ...

    def add_arm(self, hand: Hand, q: ArrayLike) -> Robot:
        """Add a hand on the arm, whose base stands at the world's origin; otherwise as :meth:`add_hand`.

        Args:
            q: the arm's 7 joints, then the hand's J, in the order of ``hand.robot.robot_joint_names``, rad.
        """
        ...

    def add_object(self, prepared: PreparedObject, T_world_object: ArrayLike, name: str) -> Body:
        """Add an object that moves freely: its convex parts collide; mass and inertia are the prepared ones."""
        ...

    def add_box(self, half_size: ArrayLike, T_world_box: ArrayLike, name: str) -> Body:
        """Add a box, ``half_size`` (3,), that does not move."""
        ...

    def add_carrier(self, half_size: ArrayLike, T_world_box: ArrayLike, name: str) -> Carrier:
        """Add a box, ``half_size`` (3,), that moves only on command."""
        ...


def torsional_friction(friction: float, patch_radius: float) -> float:
    """Return the torque, m, that a Hertz contact bears about its normal, per newton that presses it.

    The pressure over a disc of radius a is ``3 N / (2 pi a^2) sqrt(1 - r^2 / a^2)``; friction times it, times r,
    integrates to ``3 pi / 16 friction N a``.
    """
    return 3 * np.pi / 16 * friction * patch_radius


def steps_in(seconds: float, frequency: int) -> int:
    """Return the number of physics steps in a time, at least 1."""
    return max(1, round(seconds * frequency))


def pressing_links(body: Body, threshold: float) -> set[str]:
    """Return the names of the links whose impulse on ``body`` exceeded ``threshold``, N s, in the last step."""
    return {name for name, impulse in body.link_impulses().items() if np.linalg.norm(impulse) > threshold}
