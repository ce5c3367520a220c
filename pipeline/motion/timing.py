"""When to be where on a path: time-optimal under velocity and acceleration limits (TOPP-RA, Pham and Pham 2018)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import toppra
from numpy.typing import NDArray

from pipeline.motion.arm_model import ARM_ACCELERATION, ArmModel
from pipeline.motion.paths import line, without_near_duplicates

LONGEST_MOVE = 8.0  # s; anything longer is a spline gone wrong, or a path that is not worth moving along
SPLINE_SPACING = 0.15  # rad between spline knots: keeps the spline near the straight pieces of the path


@dataclass(frozen=True)
class Trajectory:
    """Joint positions and velocities (n, 7) at the times ``index / frequency``, beginning with the start."""

    positions: NDArray[np.float64]
    velocities: NDArray[np.float64]
    frequency: float

    @property
    def duration(self) -> float:
        """Seconds."""
        return (len(self.positions) - 1) / self.frequency


def time_path(
    arm: ArmModel,
    path: NDArray[np.float64],
    frequency: float,
    velocity_share: float,
    acceleration_share: float,
    spacing: float = SPLINE_SPACING,
) -> Trajectory | None:
    """Return the fastest rest-to-rest motion along a cubic spline through ``path`` (n, 7).

    None if that takes longer than ``LONGEST_MOVE``.

    Args:
        frequency: samples per second.
        velocity_share, acceleration_share: of the arm's limits.
        spacing: distance of the spline's knots, rad.
    """
    toppra.setup_logging("ERROR")
    knots = _knots(without_near_duplicates(path), spacing)
    if len(knots) == 1:
        return Trajectory(knots, np.zeros_like(knots), frequency)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))])
    velocity, acceleration = velocity_share * arm.velocity, acceleration_share * ARM_ACCELERATION
    spline = toppra.SplineInterpolator(along, knots)
    solver = toppra.algorithm.TOPPRA(
        [
            toppra.constraint.JointVelocityConstraint(np.stack([-velocity, velocity], 1)),
            toppra.constraint.JointAccelerationConstraint(np.stack([-acceleration, acceleration], 1)),
        ],
        spline,
        parametrizer="ParametrizeConstAccel",
    )
    motion = solver.compute_trajectory(0.0, 0.0)
    if motion is None or motion.duration > LONGEST_MOVE:
        return None
    count = int(np.ceil(motion.duration * frequency))
    times = np.minimum(np.arange(count + 1) / frequency, motion.duration)
    positions, velocities = motion(times), motion(times, 1)
    positions[-1], velocities[-1] = knots[-1], 0.0
    return Trajectory(positions, velocities, frequency)


def _knots(path: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Way-points (m, 7) with the pieces between them divided so that no joint moves more than ``spacing``."""
    if len(path) == 2 and np.abs(path[1] - path[0]).max() < 1e-9:
        return path[:1]
    pieces = [line(a, b, spacing)[1:] for a, b in zip(path[:-1], path[1:], strict=True)]
    return np.concatenate([path[:1], *pieces])
