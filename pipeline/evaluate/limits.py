"""What the hardware can do, and whether a sequence stays within it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.allegro import JOINT_NAMES, load_hand
from pipeline.hand.robot import ARM_JOINT_NAMES, ROBOT_JOINT_NAMES

# Franka Emika Panda, "Robot and interface specifications", table of joint limits
# (https://frankaemika.github.io/docs/control_parameters.html). The interface refuses motions that exceed any of them.
ARM_SOURCE = "Franka Emika, Robot and interface specifications: Panda, joint limits"
ARM_LOWER = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973])  # rad
ARM_UPPER = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973])  # rad
ARM_VELOCITY = np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61])  # rad/s
ARM_ACCELERATION = np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0])  # rad/s2
ARM_JERK = np.array([7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0])  # rad/s3
# Wonik Robotics, Allegro Hand: joint limits and speed of its robot description, torque of its data sheet.
HAND_SOURCE = "Wonik Robotics, Allegro Hand: robot description (angles, 3.14 rad/s)"
HAND_TORQUE_SOURCE = "Wonik Robotics, Allegro Hand: data sheet (0.7 N m)"
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
    q: NDArray[np.float64]  # (n, 23) rad, in the order of ``hand.robot.ROBOT_JOINT_NAMES``
    arm_velocity: NDArray[np.float64]  # (n, 7) rad/s


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


def _check(
    name: str,
    unit: str,
    values: NDArray[np.float64],
    lower: NDArray[np.float64],
    upper: NDArray[np.float64],
    joints: tuple[str, ...],
    waypoints: Waypoints,
    source: str,
    mend: str,
) -> Check:
    """Return the worst use of a range.

    Args:
        values: (m, joints) at the last m way-points.
    """
    middle, half = (lower + upper) / 2, (upper - lower) / 2
    used = np.abs(values - middle) / half
    row, joint = np.unravel_index(int(used.argmax()), used.shape)
    moment = int(row) + len(waypoints.times) - len(values)
    return Check(
        name=name,
        unit=unit,
        value=float(values[row, joint]),
        lower=float(lower[joint]),
        upper=float(upper[joint]),
        used=float(used[row, joint]),
        joint=joints[int(joint)],
        time=float(waypoints.times[moment]),
        phase=waypoints.phases[moment],
        source=source,
        mend=mend,
    )


def weight_torques(q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the torques (n, 16), N m, with which the hand's joints carry the fingers' own weight at ``q`` (n, 23)."""
    import pinocchio as pin

    from pipeline.hand.robot import robot_file

    model = pin.buildModelFromUrdf(str(robot_file(arm=True)))
    data = model.createData()
    joints = [model.joints[model.getJointId(name)] for name in ROBOT_JOINT_NAMES]
    place, speed = [joint.idx_q for joint in joints], [joint.idx_v for joint in joints[7:]]
    torques = np.zeros((len(q), 16))
    for row, angles in enumerate(q):
        configuration = np.zeros(model.nq)
        configuration[place] = angles
        torques[row] = pin.computeGeneralizedGravity(model, data, configuration)[speed]
    return torques


def check_limits(waypoints: Waypoints, squeeze_torque: NDArray[np.float64]) -> list[Check]:
    """Return all checks of a sequence.

    Velocities are the larger of those told to the arm and the difference quotients of positions; accelerations and
    jerks are difference quotients, so means over one or two way-points.

    Args:
        squeeze_torque: (16,) N m, what the drives of the fingers ask for at most while objects are squeezed.
    """
    times, q = waypoints.times, waypoints.q
    step = float(times[1] - times[0])
    arm, hand = q[:, :7], q[:, 7:]
    speeds = np.diff(q, axis=0) / step
    told = waypoints.arm_velocity[1:]
    arm_speed = np.where(np.abs(told) > np.abs(speeds[:, :7]), told, speeds[:, :7])
    acceleration = np.diff(waypoints.arm_velocity, axis=0) / step
    jerk = np.diff(acceleration, axis=0, prepend=np.zeros((1, 7))) / step
    hand_limits, ones = load_hand(), np.ones(16)

    def of_arm(name: str, unit: str, values: NDArray[np.float64], limit: NDArray[np.float64]) -> Check:
        return _check(name, unit, values, -limit, limit, ARM_JOINT_NAMES, waypoints, ARM_SOURCE, OTHER_GRASP)

    def of_hand(
        name: str, unit: str, values: NDArray[np.float64], limit: float, source: str, mend: str = OTHER_GRASP
    ) -> Check:
        return _check(name, unit, values, -limit * ones, limit * ones, JOINT_NAMES, waypoints, source, mend)

    lower, upper = hand_limits.lower, hand_limits.upper
    return [
        _check("arm position", "rad", arm, ARM_LOWER, ARM_UPPER, ARM_JOINT_NAMES, waypoints, ARM_SOURCE, OTHER_GRASP),
        of_arm("arm velocity", "rad/s", arm_speed, ARM_VELOCITY),
        of_arm("arm acceleration", "rad/s2", acceleration, ARM_ACCELERATION),
        of_arm("arm jerk", "rad/s3", jerk, ARM_JERK),
        _check("hand position", "rad", hand, lower, upper, JOINT_NAMES, waypoints, HAND_SOURCE, OTHER_GRASP),
        of_hand("hand velocity", "rad/s", speeds[:, 7:], HAND_VELOCITY, HAND_SOURCE, SLOWER),
        of_hand("hand torque of squeezing", "N m", squeeze_torque[None], HAND_TORQUE, HAND_TORQUE_SOURCE, WEAKER),
        of_hand("hand torque of the fingers' weight", "N m", weight_torques(q), HAND_TORQUE, HAND_TORQUE_SOURCE),
    ]
