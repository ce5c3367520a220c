"""The canonical object frame: declared up axis to +z, origin at the centre of mass, coordinates as they are saved."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.shapes.mass import solid_properties

# Rows are the new x, y, z axes in the axes of the source; each is the shortest turn that brings `up` to +z.
ROTATIONS: dict[str, NDArray[np.float64]] = {
    "+z": np.eye(3),
    "-z": np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]]),
    "+x": np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]]),
    "-x": np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
    "+y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "-y": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
}


def as_saved(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """Round to the float32 that files hold, so that what is computed here is what others load."""
    return array.astype(np.float32).astype(np.float64)


def turned(vertices: NDArray[np.float64], degrees: float) -> NDArray[np.float64]:
    """Return vertices (V, 3) turned about +z, counter-clockwise seen from above."""
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return vertices @ np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def canonical_vertices(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], up: str, turn: float | None = None
) -> NDArray[np.float64]:
    """Return vertices (V, 3) in the object frame.

    Args:
        vertices: (V, 3) of a closed solid in the axes of its source, m.
        up: source axis that points up, such as ``+y``.
        turn: about the vertical, degrees; None leaves even the last digit alone.
    """
    upright = vertices @ ROTATIONS[up].T
    if turn is not None:
        upright = turned(upright, turn)
    _, centre, _ = solid_properties(upright, faces)
    return as_saved(upright - centre)
