"""The robot at its table: one moment of a sequence as a picture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh
from numpy.typing import NDArray

from pipeline.hand.model import Hand
from pipeline.pictures.camera import look_at
from pipeline.pictures.colours import SPONGE_COLOUR
from pipeline.pictures.render import Body, render
from pipeline.pictures.robot import robot_bodies
from pipeline.shapes.workplace import SPONGE_SIZE, SPONGE_X

CAMERA_POSITION, CAMERA_TARGET, CAMERA_DEGREES = (1.55, -0.62, 0.70), (0.46, 0.0, 0.28), 27.0


def moment_picture(
    robot_q: NDArray[np.float64], hand: Hand, objects: Sequence[Body], sponge_height: float, width: int, height: int
) -> NDArray[np.uint8]:
    """Return a picture (height, width, 3) of the robot at ``robot_q`` (7 + J,), rad, objects and sponge.

    Args:
        objects: placed in the world frame.
        sponge_height: m.
    """
    bodies = [*robot_bodies(robot_q, hand), *objects, _sponge(sponge_height)]
    camera = look_at(CAMERA_POSITION, CAMERA_TARGET, CAMERA_DEGREES)
    return render(bodies, camera, width, height, floor=0.0)


def _sponge(height: float) -> Body:
    T = np.eye(4)
    T[:3, 3] = (SPONGE_X, 0.0, height / 2)
    box = trimesh.creation.box((SPONGE_SIZE, SPONGE_SIZE, height))
    return Body(np.asarray(box.vertices), np.asarray(box.faces), SPONGE_COLOUR, T)
