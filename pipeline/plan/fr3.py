"""Limits of the Franka Research 3, the Panda's successor, whose fastest speed depends on where a joint is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from pipeline.hand.robot import ARM_JOINT_NAMES
from pipeline.plan.limits import ARM_PERIOD, Check, Limit, Waypoints, worst_use

# Franka Robotics, franka_description: joint limits and position-based velocity limits of the FR3.
SOURCE = "Franka Robotics, franka_description: limits for FR3"
LOWER = np.array([-2.9007, -1.8361, -2.9007, -3.0770, -2.8763, 0.4398, -3.0508])  # rad
UPPER = np.array([2.9007, 1.8361, 2.9007, -0.1169, 2.8763, 4.6216, 3.0508])  # rad
VELOCITY = np.array([2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26])  # rad/s
ACCELERATION = np.full(7, 10.0)  # rad/s2
JERK = np.full(7, 5000.0)  # rad/s3
DECELERATION = np.array([6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0])  # rad/s2, with which a joint must be able to stop
SLOWEST = 1e-6  # rad/s, instead of none: a joint at its limit may rest there
OFFSET = np.array([0.652, 0.25, 0.2005, 0.3542, 0.5738, 0.4885, 0.4592])  # rad/s


def fastest(q: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lowest (negative) and highest velocity (n, 7), rad/s, of joints at ``q`` (n, 7), rad.

    A joint must be able to stop before its limit: v = sqrt(2 a d) - offset, d the way that is left, and at most
    ``VELOCITY``.
    """

    def towards(way: NDArray[np.float64]) -> NDArray[np.float64]:
        speed = np.sqrt(2 * DECELERATION * np.maximum(way, 0)) - OFFSET
        return np.clip(speed, SLOWEST, VELOCITY)

    return -towards(q - LOWER), towards(UPPER - q)


def check_fr3(waypoints: Waypoints) -> list[Check]:
    """Return the checks of an arm's motion for the FR3, every millisecond of the spline through its way-points."""
    times = waypoints.times
    spline = CubicSpline(times, waypoints.q[:, :7], bc_type="clamped")
    moments = np.minimum(ARM_PERIOD * np.arange(round(times[-1] / ARM_PERIOD) + 1), times[-1])
    q = spline(moments)
    slowest, highest = fastest(q)
    bounds = (
        ("position", "rad", q, LOWER, UPPER),
        ("velocity", "rad/s", spline(moments, 1), slowest, highest),
        ("acceleration", "rad/s2", spline(moments, 2), -ACCELERATION, ACCELERATION),
        ("jerk", "rad/s3", spline(moments, 3), -JERK, JERK),
    )
    return [
        worst_use(Limit(f"FR3 {name}", unit, low, high, ARM_JOINT_NAMES, SOURCE), values, moments, waypoints)
        for name, unit, values, low, high in bounds
    ]
