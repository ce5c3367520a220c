"""The physics engine in use: the one place that names implementations of :class:`pipeline.physics.engine.World`."""

from __future__ import annotations

from numpy.typing import ArrayLike

from pipeline.physics.engine import GRAVITY, World
from pipeline.records.errors import UserError
from pipeline.records.parameters.physics import PhysicsParameters


def make_world(settings: PhysicsParameters, gravity: ArrayLike = (0.0, 0.0, -GRAVITY)) -> World:
    """Return an empty world with constant ``gravity`` (3,), m/s2, world frame.

    Raises:
        UserError: ``settings.engine`` is not one engine.
    """
    if settings.engine == "both":
        raise UserError(
            "physics.engine is both, but a trial runs in one engine; set physics.engine to sapien or mujoco for it."
        )
    if settings.engine == "mujoco":
        from pipeline.physics.mujoco_world import MujocoWorld

        return MujocoWorld(settings, gravity)
    from pipeline.physics.sapien_world import cpu_world

    return cpu_world(settings, gravity)
