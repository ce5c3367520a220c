"""Arm motion: inverse kinematics, collision-free planning, time parametrisation."""
