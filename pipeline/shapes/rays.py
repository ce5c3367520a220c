"""Rays and distances to meshes."""

from __future__ import annotations

from typing import Any

import numpy as np
import open3d
from numpy.typing import ArrayLike


def ray_scene(*meshes: tuple[ArrayLike, ArrayLike]) -> Any:
    """Return Open3D's ray and distance queries, on one thread, for meshes that are numbered in this order.

    Args:
        meshes: vertices (V, 3) and faces (F, 3) of each, all in one frame.
    """
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    for vertices, faces in meshes:
        scene.add_triangles(
            open3d.core.Tensor(np.ascontiguousarray(vertices, np.float32)),
            open3d.core.Tensor(np.ascontiguousarray(faces, np.uint32)),
        )
    return scene
