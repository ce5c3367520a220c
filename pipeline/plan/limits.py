"""What the hardware can do, and whether a sequence stays within it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from pipeline.hand.model import Hand
from pipeline.hand.robot import ARM_JOINT_NAMES, all_joint_names, all_positions, robot_file
from pipeline.motion.arm_model import ARM_ACCELERATION

# Franka Emika, "Robot and interface specifications", limits for Panda
# (https://frankaemika.github.io/docs/control_parameters.html). The interface aborts motions that exceed any of them.
ARM_SOURCE = "Franka Emika, Robot and interface specifications: limits for Panda"
ARM_LOWER = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973])  # rad
ARM_UPPER = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973])  # rad
ARM_VELOCITY = np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61])  # rad/s
ARM_JERK = np.array([7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0])  # rad/s3
ARM_PERIOD = 0.001  # s, between commands to the arm
# Angles: the URDF of Wonik Robotics (allegro_hand_ros), which the one that physics loads repeats. Speed: the latter's
# (dex-urdf, as ManiSkill brings it); Wonik's URDF leaves speeds and torques open.
HAND_ANGLE_SOURCE = "Wonik Robotics, Allegro Hand: angles of allegro_hand_ros"
HAND_VELOCITY_SOURCE = "dex-urdf, description of the Allegro hand (3.14 rad/s); not the maker's own figure"
# The figure that is in common use. The maker's manual was not at hand: whether it is a peak, or may last, is not known.
HAND_TORQUE_SOURCE = "about 0.7 N m, in common use for the Allegro hand; compare it with the manual of yours"
HAND_VELOCITY = 3.14  # rad/s
HAND_TORQUE = 0.7  # N m
ROUNDING = 1e-9  # share of a limit
OTHER_GRASP = "choose another grasp with --merged-id"
SLOWER = "lengthen evaluate.open_seconds or evaluate.close_seconds in params.yaml, or choose another grasp"
WEAKER = "lower physics.hand_torque_limit in params.yaml"


@dataclass(frozen=True)
class Waypoints:
    """The whole sequence; the first row is the start, at rest."""

    times: NDArray[np.float64]  # (n,) s, evenly spaced
    phases: tuple[str, ...]  # (n,) the phase in which the robot gets there
    q: NDArray[np.float64]  # (n, R) rad, in the order of ``hand.robot.robot_joint_names``: the arm's, the hand's
    arm_velocity: NDArray[np.float64]  # (n, 7) rad/s

    def rows(self) -> Iterator[tuple[float, str, list[float], list[float]]]:
        """Yield time, phase, positions (R) and velocities of the arm (7) of every way-point, as plain numbers."""
        return zip(self.times.tolist(), self.phases, self.q.tolist(), self.arm_velocity.tolist(), strict=True)


@dataclass(frozen=True)
class Check:
    """One kind of limit, at the joint and moment where it is used most."""

    name: str
    unit: str
    value: float  # of that joint at that time
    lower: float  # of that joint
    upper: float
    used: float  # share of the limit; of a range, distance from its middle over half its width; above 1 is a violation
    joint: str
    time: float  # s
    phase: str
    source: str
    mend: str

    @property
    def passed(self) -> bool:
        """Whether the limit holds."""
        return self.used <= 1 + ROUNDING

    def sentence(self) -> str:
        """Return what is wrong, for a check that did not pass."""
        bound = self.upper if self.value > (self.lower + self.upper) / 2 else self.lower
        return (
            f"{self.name} of {self.joint} is {self.value:.4g} {self.unit} at {self.time:.2f} s ({self.phase}), beyond "
            f"the hardware's {bound:.4g} {self.unit}; {self.mend}"
        )


@dataclass(frozen=True)
class Limit:
    """What hardware can do, and what to do about a sequence that asks for more."""

    name: str
    unit: str
    lower: NDArray[np.float64]  # (joints,), or (m, joints) where it differs from moment to moment
    upper: NDArray[np.float64]  # likewise
    joints: tuple[str, ...]
    source: str
    mend: str = OTHER_GRASP


def _arm_limit(name: str, unit: str, bound: NDArray[np.float64]) -> Limit:
    return Limit(f"arm {name}", unit, -bound, bound, ARM_JOINT_NAMES, ARM_SOURCE)


def _hand_limit(hand: Hand, name: str, unit: str, bound: float, source: str, mend: str = OTHER_GRASP) -> Limit:
    bounds = np.full(hand.joint_count, bound)
    return Limit(f"hand {name}", unit, -bounds, bounds, hand.joint_names, source, mend)


def worst_use(limit: Limit, values: NDArray[np.float64], times: NDArray[np.float64], waypoints: Waypoints) -> Check:
    """Return the worst use of a limit.

    Args:
        values: (m, joints).
        times: (m,) s, when the values hold.
    """
    lower, upper = np.broadcast_to(limit.lower, values.shape), np.broadcast_to(limit.upper, values.shape)
    middle, half = (lower + upper) / 2, (upper - lower) / 2
    used = np.abs(values - middle) / half
    row, joint = (int(index) for index in np.unravel_index(int(used.argmax()), used.shape))
    # a phase lasts from behind the last way-point of the one before to its own last
    reached = min(int(np.searchsorted(waypoints.times, times[row] - ARM_PERIOD / 2)), len(waypoints.times) - 1)
    return Check(
        name=limit.name,
        unit=limit.unit,
        value=float(values[row, joint]),
        lower=float(lower[row, joint]),
        upper=float(upper[row, joint]),
        used=float(used[row, joint]),
        joint=limit.joints[joint],
        time=float(times[row]),
        phase=waypoints.phases[reached],
        source=limit.source,
        mend=limit.mend,
    )


def weight_torques(hand: Hand, q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the torques (n, J), N m, with which the hand's joints carry the fingers' own weight at ``q`` (n, R).

    Those of coupled joints count at the joint that drives them.
    """
    model = pin.buildModelFromUrdf(str(robot_file(True, hand)))
    data = model.createData()
    joints = [model.joints[model.getJointId(name)] for name in all_joint_names(True, hand)]
    place, speed = [joint.idx_q for joint in joints], [joint.idx_v for joint in joints[7:]]
    torques = np.zeros((len(q), hand.joint_count))
    for row, angles in enumerate(all_positions(True, hand, q)):
        configuration = np.zeros(model.nq)
        configuration[place] = angles
        carried = hand.physical.multiplier * pin.computeGeneralizedGravity(model, data, configuration)[speed]
        np.add.at(torques[row], hand.physical.driver, carried)
    return torques


def _arm_checks(waypoints: Waypoints) -> list[Check]:
    """Return the checks of the arm, between way-points too.

    Between way-points an arm goes as its controller interpolates. What is checked is the cubic spline with continuous
    acceleration through all positions, at rest at both ends, every millisecond; besides that, the target velocities at
    the way-points, and their difference quotients.
    """
    times, velocity = waypoints.times, waypoints.arm_velocity
    step = float(times[1] - times[0])
    spline = CubicSpline(times, waypoints.q[:, :7], bc_type="clamped")
    moments = np.minimum(ARM_PERIOD * np.arange(round(times[-1] / ARM_PERIOD) + 1), times[-1])
    acceleration = np.diff(velocity, axis=0) / step
    jerk = np.diff(acceleration, axis=0, prepend=np.zeros((1, 7))) / step
    position = Limit("arm position", "rad", ARM_LOWER, ARM_UPPER, ARM_JOINT_NAMES, ARM_SOURCE)
    checks = [worst_use(position, spline(moments), moments, waypoints)]
    for order, (name, unit, bound, quotients) in enumerate(
        (
            ("velocity", "rad/s", ARM_VELOCITY, velocity[1:]),
            ("acceleration", "rad/s2", ARM_ACCELERATION, acceleration),
            ("jerk", "rad/s3", ARM_JERK, jerk),
        ),
        start=1,
    ):
        values = np.concatenate([spline(moments, order), quotients])
        checks.append(worst_use(_arm_limit(name, unit, bound), values, np.concatenate([moments, times[1:]]), waypoints))
    return checks


def _hand_checks(hand: Hand, waypoints: Waypoints, squeeze_torque: NDArray[np.float64]) -> list[Check]:
    times, q = waypoints.times, waypoints.q
    speeds = np.diff(q[:, 7:], axis=0) / (times[1] - times[0])
    position = Limit("hand position", "rad", hand.lower, hand.upper, hand.joint_names, HAND_ANGLE_SOURCE)
    velocity = _hand_limit(hand, "velocity", "rad/s", HAND_VELOCITY, HAND_VELOCITY_SOURCE, SLOWER)
    squeezing = _hand_limit(hand, "torque of squeezing", "N m", HAND_TORQUE, HAND_TORQUE_SOURCE, WEAKER)
    weight = _hand_limit(hand, "torque of the fingers' weight", "N m", HAND_TORQUE, HAND_TORQUE_SOURCE)
    return [
        worst_use(position, q[:, 7:], times, waypoints),
        worst_use(velocity, speeds, times[1:], waypoints),
        worst_use(squeezing, squeeze_torque[None], times[-1:], waypoints),
        worst_use(weight, weight_torques(hand, q), times, waypoints),
    ]


def check_limits(hand: Hand, waypoints: Waypoints, squeeze_torque: NDArray[np.float64]) -> list[Check]:
    """Return all checks of a sequence.

    Args:
        squeeze_torque: (J,) N m, what the drives of the fingers ask for at most while objects are squeezed.
    """
    return _arm_checks(waypoints) + _hand_checks(hand, waypoints, squeeze_torque)
