"""A vessel that is modelled as a surface without thickness becomes a solid: everything within half a wall of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.prepare.level_set import sampling_grid, zero_surface
from pipeline.records.errors import UserError
from pipeline.shapes.rays import ray_scene

CELLS_IN_WALL = 2.5
MOST_CELLS = 250  # on the longest axis; what is thinner could not be seen in the distance grid either


def thickened(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], wall: float, name: str
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the closed surface (vertices, outward faces) around all points within ``wall / 2`` of a surface.

    Args:
        wall: thickness, m.

    Raises:
        UserError: the wall is too thin for the size of the object.
    """
    low, high = vertices.min(axis=0) - wall / 2, vertices.max(axis=0) + wall / 2
    longest = float((high - low).max())
    spacing = wall / CELLS_IN_WALL
    if longest > MOST_CELLS * spacing:
        least = np.ceil(1e4 * longest * CELLS_IN_WALL / MOST_CELLS) / 1e4
        raise UserError(
            f"{name}: a wall of {1000 * wall:.3g} mm cannot be resolved in an object of {1000 * longest:.0f} mm; set "
            f"`wall` to {least:g} or more."
        )
    points, origin, shape = sampling_grid(low, high, spacing)
    scene: Any = ray_scene((vertices, faces))
    distance = scene.compute_distance(points.astype(np.float32), nthreads=1).numpy().astype(np.float64)
    return zero_surface((wall / 2 - distance).reshape(shape), origin, spacing, low, high)
