"""The canonical object frame: declared up axis to +z, origin at the centre of mass, coordinates as they are saved."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.prepare.mass import solid_properties

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


def canonical_vertices(vertices: NDArray[np.float64], faces: NDArray[np.int64], up: str) -> NDArray[np.float64]:
    """Return vertices (V, 3) in the object frame.

    Args:
        vertices: (V, 3) of a closed solid in the axes of its source, m.
        up: source axis that points up, such as ``+y``.
    """
    turned = vertices @ ROTATIONS[up].T
    _, centre, _ = solid_properties(turned, faces)
    return as_saved(turned - centre)
