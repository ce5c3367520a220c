"""The stage set of a rendered capture: a block of foam on a table, tags on the foam, cameras around it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

TABLE = (1.23, 0.82)  # m, extents
FOAM = (0.68, 0.56, 0.10)  # m, extents; its top is z = 0
# Centre (m) and yaw (degrees) of the tags; the order is that in which they are laid, so that few tags are spread too.
TAG_PLACES = (
    (-0.190, -0.130, 0.0),
    (0.190, 0.130, 30.0),
    (0.190, -0.130, 90.0),
    (-0.190, 0.130, -20.0),
    (0.000, -0.175, 180.0),
    (0.000, 0.175, 45.0),
)
ELEVATIONS = (32.0, 42.0, 55.0)  # degrees over the foam, one circle of cameras each
TARGET_HEIGHT = 0.035  # m, what the cameras look at


def camera_poses(views: int, distance: float, random: np.random.Generator) -> NDArray[np.float64]:
    """Return ``T_camera_scene`` (views, 4, 4): hand-held, three circles with a little disorder; x right, y down.

    Args:
        distance: from the camera to the middle of the scene, m.
    """
    poses = np.zeros((views, 4, 4))
    for view in range(views):
        ring = view % len(ELEVATIONS)
        azimuth = 2 * np.pi * (view + 0.25 * random.standard_normal()) / views
        elevation = np.radians(ELEVATIONS[ring] + 1.5 * random.standard_normal())
        away = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
        target = np.array([0, 0, TARGET_HEIGHT]) + 0.01 * random.standard_normal(3)
        centre = target + away * distance * (1 + 0.03 * random.standard_normal())
        forward = (target - centre) / np.linalg.norm(target - centre)
        right = np.cross(forward, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        roll = np.radians(2.0 * random.standard_normal())
        down = np.cross(forward, right)
        right, down = np.cos(roll) * right + np.sin(roll) * down, np.cos(roll) * down - np.sin(roll) * right
        poses[view, :3, :3] = np.stack([right, down, forward])
        poses[view, :3, 3] = -poses[view, :3, :3] @ centre
        poses[view, 3, 3] = 1
    return poses
