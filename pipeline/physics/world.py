"""The physics engine in use: the one place that names an implementation of :class:`pipeline.physics.engine.World`."""

from __future__ import annotations

from numpy.typing import ArrayLike

from pipeline.physics.engine import GRAVITY, World
from pipeline.physics.sapien_world import cpu_world
from pipeline.records.parameters.physics import PhysicsParameters


def make_world(settings: PhysicsParameters, gravity: ArrayLike = (0.0, 0.0, -GRAVITY)) -> World:
    """Return an empty world with constant ``gravity`` (3,), m/s2, world frame."""
    return cpu_world(settings, gravity)
