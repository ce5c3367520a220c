"""Does the object stand as declared, and how else could it rest?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from pipeline.shapes.convex_parts import reduced_hull

CONTACT_TOLERANCE = 4e-4  # m; points this close to the lowest carry the object (scans are rough)
STABLE_HULL_VERTICES = 150  # the pose list is quadratic in faces


@dataclass(frozen=True)
class Stance:
    """How the object stands on a plane with +z up."""

    margin: float  # m from the centre of mass to the nearest edge of the support polygon; negative: it falls over
    tip_angle: float  # rad that it can be tilted before it falls over


def stance(vertices: NDArray[np.float64]) -> Stance:
    """Return how the object (origin at the centre of mass) stands with +z up."""
    bottom = float(vertices[:, 2].min())
    carrying = vertices[vertices[:, 2] < bottom + CONTACT_TOLERANCE, :2]
    try:
        hull = ConvexHull(carrying)
    except (QhullError, ValueError):  # a point or an edge carries it
        return Stance(0.0, 0.0)
    margin = float(-hull.equations[:, 2].max())  # the centre of mass is at the origin
    return Stance(margin, float(np.arctan2(margin, -bottom)))


def stable_poses(vertices: NDArray[np.float64]) -> list[dict[str, object]]:
    """Return resting poses for information, the likeliest first: probability, tilt from +z (deg), which way is up.

    After Goldberg et al., as implemented by trimesh, without randomness.
    """
    (hull_vertices, hull_faces), _ = reduced_hull(vertices, STABLE_HULL_VERTICES)
    hull = trimesh.Trimesh(hull_vertices, hull_faces, process=False)
    transforms, probabilities = trimesh.poses.compute_stable_poses(
        hull, center_mass=np.zeros(3), sigma=0.0, n_samples=1, threshold=0.02
    )
    poses = []
    for T, probability in sorted(zip(transforms, probabilities, strict=True), key=lambda pair: -pair[1])[:12]:
        up = T[2, :3]
        poses.append(
            {
                "probability": round(float(probability), 4),
                "tilt_degrees": round(float(np.degrees(np.arccos(np.clip(up[2], -1, 1)))), 2),
                "up": [round(float(value), 4) for value in up],
            }
        )
    return poses
