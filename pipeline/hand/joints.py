"""The joints that a hand has, and how the fewer independent ones drive them.

Tables, targets and gradients are of the ``J`` independent joints. A coupled joint follows one of them: its position is
``multiplier`` times that of its driver, plus ``offset``. Physics has no gears: every joint has a drive of its own, and
the target of a coupled one follows that of its driver.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.hand.urdf import Follower, Urdf
from pipeline.records.parameters.hand import DrivesDescription, HandDescription
from pipeline.records.parameters.physics import PhysicsParameters


@dataclass(frozen=True, eq=False)
class PhysicalJoints:
    """All ``P`` joints of a hand: the independent ones in their order, then those that follow them."""

    names: tuple[str, ...]  # (P,)
    driver: NDArray[np.int64]  # (P,) independent joint, of an independent one itself
    multiplier: NDArray[np.float64]  # (P,) 1 of an independent joint; m/rad or rad/m between kinds
    offset: NDArray[np.float64]  # (P,) 0 of an independent joint; rad or m
    slides: NDArray[np.bool_]  # (P,) along its axis, positions in m; others turn, positions in rad
    stiffness: NDArray[np.float64]  # (P,) of the drive, N m/rad or N/m; not a number: that of the physics settings
    damping: NDArray[np.float64]  # (P,) likewise, N m s/rad or N s/m
    limit: NDArray[np.float64]  # (P,) likewise, N m or N

    @property
    def coupled(self) -> bool:
        """Whether any joint follows another."""
        return len(self.names) > int(self.driver.max(initial=-1)) + 1

    def positions(self, q: ArrayLike) -> NDArray[np.float64]:
        """Return positions (..., P) of all joints for ``q`` (..., J) of the independent ones."""
        independent = np.asarray(q, np.float64)
        if not self.coupled:
            return independent
        return self.multiplier * independent[..., self.driver] + self.offset

    def velocities(self, velocity: ArrayLike) -> NDArray[np.float64]:
        """Return velocities (..., P) of all joints for those (..., J) of the independent ones."""
        independent = np.asarray(velocity, np.float64)
        return self.multiplier * independent[..., self.driver] if self.coupled else independent

    def drives(
        self, settings: PhysicsParameters
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return stiffness, damping and limit (P,) of the drives under some physics settings."""
        return (
            np.where(np.isnan(self.stiffness), settings.hand_stiffness, self.stiffness),
            np.where(np.isnan(self.damping), settings.hand_damping, self.damping),
            np.where(np.isnan(self.limit), settings.hand_torque_limit, self.limit),
        )

    def together(self, settings: PhysicsParameters) -> NDArray[np.float64]:
        """Return the largest torques, N m, or forces, N, (J,) at the independent joints, with what follows them."""
        total = np.zeros(int(self.driver.max()) + 1)
        np.add.at(total, self.driver, np.abs(self.multiplier) * self.drives(settings)[2])
        return total


def physical_joints(description: HandDescription, urdf: Urdf) -> tuple[PhysicalJoints, Mapping[str, Follower]]:
    """Return all joints of a hand, and those that follow others; what does not fit goes to ``urdf.mistakes``."""
    followers = {name: found for name, joint in urdf.moving_joints.items() if (found := urdf.follower(joint))}
    for name in description.joints:
        if name not in urdf.joints:
            urdf.mistakes.append(f"joints names {name!r}, which the URDF {urdf.file.name} does not have")
        elif name in followers:
            urdf.mistakes.append(f"joints names {name!r}, which follows {followers[name].joint!r}; remove it")
        elif name not in urdf.moving_joints:
            urdf.mistakes.append(f"joints names {name!r}, which does not move in {urdf.file.name}; remove it")
    for name in urdf.moving_joints:
        if name not in description.joints and name not in followers:
            urdf.mistakes.append(f"the joint {name!r} of {urdf.file.name} moves; add it to joints and to a finger")
    known = [name for name in followers if followers[name].joint in description.joints]
    names = (*description.joints, *known)
    couplings = [Follower(name, 1.0, 0.0) if name in description.joints else followers[name] for name in names]
    drives = np.array([_drive(name, description.drives, urdf) for name in names]).reshape(-1, 3)
    for name in description.drives.joints:
        if name not in names:
            urdf.mistakes.append(f"drives.joints names {name!r}, which is no moving joint; correct or remove it")
    joints = PhysicalJoints(
        names=names,
        driver=np.array([description.joints.index(own.joint) for own in couplings], dtype=np.int64),
        multiplier=np.array([own.multiplier for own in couplings]),
        offset=np.array([own.offset for own in couplings]),
        slides=np.array([name in urdf.joints and urdf.slides(urdf.joints[name]) for name in names]),
        stiffness=drives[:, 0],
        damping=drives[:, 1],
        limit=drives[:, 2],
    )
    return joints, followers


def _drive(name: str, described: DrivesDescription, urdf: Urdf) -> tuple[float, float, float]:
    """Return stiffness, damping and limit of a joint's drive, not a number where the physics settings have it."""
    own = described.joints.get(name)
    stiffness, damping, limit = (None, None, None) if own is None else (own.stiffness, own.damping, own.limit)
    joint = urdf.moving_joints.get(name)
    slides = joint is not None and urdf.slides(joint)
    if limit is None and joint is not None and (slides or described.limits_of_urdf):
        limit = urdf.effort(joint)
    if slides and None in (stiffness, damping, limit):
        urdf.mistakes.append(
            f"the joint {name!r} slides, and physics' drives are those of turning joints; give it stiffness, damping "
            "and limit under drives.joints"
        )
    return tuple(np.nan if value is None else value for value in (stiffness, damping, limit))  # type: ignore[return-value]


def joint_limits(joints: PhysicalJoints, count: int, urdf: Urdf) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return lower and upper limits (J,) of the independent joints: their own, cut to what their followers can do."""
    lower, upper = np.full(count, -np.inf), np.full(count, np.inf)
    for index, name in enumerate(joints.names):
        if name not in urdf.moving_joints:
            continue
        ends = np.array(urdf.limits(urdf.moving_joints[name]))
        if index >= count:
            if joints.multiplier[index] == 0.0:
                continue
            ends = np.sort((ends - joints.offset[index]) / joints.multiplier[index])
        driver = joints.driver[index]
        lower[driver], upper[driver] = max(lower[driver], ends[0]), min(upper[driver], ends[1])
    for driver in np.flatnonzero(lower >= upper):
        urdf.mistakes.append(
            f"the joint {joints.names[driver]!r} and those that follow it have limits of {urdf.file.name} that no "
            "position satisfies; correct the limits, or the mimic's multiplier and offset"
        )
    return lower, upper
