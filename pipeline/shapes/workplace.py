"""Where sponge and table stand in front of the robot: world frame, origin in the robot's base, table top at z = 0."""

from __future__ import annotations

SPONGE_SIZE = 0.4  # m, square. Paper's code: 0.4.
SPONGE_X = 0.5  # m in front of the robot's base. Paper's code: 0.5.
TABLE_SIZE = (2.0, 2.4, 0.1)  # m
TABLE_X = 0.5  # m
