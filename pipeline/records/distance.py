"""Look-ups in the signed-distance grid of a prepared object."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.records.objects import PreparedObject


def signed_distance(prepared: PreparedObject, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return signed distances (...) of ``points`` (..., 3), object frame, m; positive outside, trilinear.

    Outside the grid the distance to the grid's box is added to the value at its border: an upper bound on the true
    distance that is exact enough for clearance tests, which only care about what is near.
    """
    from scipy.ndimage import map_coordinates

    flat = points.reshape(-1, 3)
    coordinates = (flat - prepared.distance_origin) / prepared.distance_spacing
    inside = np.clip(coordinates, 0, np.array(prepared.distance.shape) - 1)
    value = map_coordinates(prepared.distance, inside.T, order=1, output=np.float64)
    beyond = np.linalg.norm(coordinates - inside, axis=1) * prepared.distance_spacing
    return (value + beyond).reshape(points.shape[:-1])
