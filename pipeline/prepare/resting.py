"""Does the object stand as declared, and how else could it rest?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from pipeline.shapes.convex_parts import reduced_hull

CONTACT_TOLERANCE = 4e-4  # m; points this close to the lowest carry the object (scans are rough)
SMALLEST_MARGIN = 0.002  # m, of the support polygon around the centre of mass
SMALLEST_TIP_ANGLE = np.radians(5.0)
FLAT_TOLERANCE = 2e-5  # m; the same of a flat face
STABLE_HULL_VERTICES = 150  # the pose list is quadratic in faces


@dataclass(frozen=True)
class Stance:
    """How the object stands on a plane with +z up."""

    margin: float  # m from the centre of mass to the nearest edge of the support polygon; negative: it falls over
    tip_angle: float  # rad that it can be tilted before it falls over

    @property
    def firm(self) -> bool:
        """Whether it stands well enough to be grasped."""
        return self.margin >= SMALLEST_MARGIN and self.tip_angle >= SMALLEST_TIP_ANGLE


def stance(vertices: NDArray[np.float64], tolerance: float = CONTACT_TOLERANCE) -> Stance:
    """Return how the object (origin at the centre of mass) stands with +z up.

    Args:
        tolerance: m above the lowest point, within which points carry the object.
    """
    bottom = float(vertices[:, 2].min())
    carrying = vertices[vertices[:, 2] < bottom + tolerance, :2]
    try:
        hull = ConvexHull(carrying)
    except (QhullError, ValueError):  # a point or an edge carries it
        return Stance(0.0, 0.0)
    margin = float(-hull.equations[:, 2].max())  # the centre of mass is at the origin
    return Stance(margin, float(np.arctan2(margin, -bottom)))


def resting_ups(vertices: NDArray[np.float64]) -> list[tuple[NDArray[np.float64], float]]:
    """Return the directions (3,) that point up when a solid rests, with their probabilities, the likeliest first.

    A round side has as many poses as facets, so that each of them has little probability. After Goldberg et al., as
    implemented by trimesh, without randomness.

    Args:
        vertices: (V, 3), origin at the centre of mass.
    """
    (hull_vertices, hull_faces), _ = reduced_hull(vertices, STABLE_HULL_VERTICES)
    hull = trimesh.Trimesh(hull_vertices, hull_faces, process=False)
    transforms, probabilities = trimesh.poses.compute_stable_poses(
        hull, center_mass=np.zeros(3), sigma=0.0, n_samples=1, threshold=0.0
    )
    order = np.argsort(-np.asarray(probabilities), kind="stable")
    return [(np.asarray(transforms[index][2, :3]), float(probabilities[index])) for index in order]


def upright(up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the shortest rotation (3, 3) that brings a unit vector (3,) to +z."""
    if up[2] < -1 + 1e-9:
        return np.diag([1.0, -1.0, -1.0])
    x, y, z = up
    return np.array(
        [[1 - x * x / (1 + z), -x * y / (1 + z), -x], [-x * y / (1 + z), 1 - y * y / (1 + z), -y], [x, y, z]]
    )


def poses(vertices: NDArray[np.float64], most: int) -> list[tuple[NDArray[np.float64], float]]:
    """Return the rotations (3, 3) into poses in which a solid stands, with their probabilities.

    Those on flat faces come first, then those on rough or round ones, on which it may roll; the likeliest first.

    Args:
        vertices: (V, 3), origin at the centre of mass, m.
        most: how many are wanted.
    """
    flat: list[tuple[NDArray[np.float64], float]] = []
    others: list[tuple[NDArray[np.float64], float]] = []
    for up, probability in resting_ups(vertices):
        R = upright(up)
        if stance(vertices @ R.T).firm:
            (flat if stance(vertices @ R.T, FLAT_TOLERANCE).firm else others).append((R, probability))
        if len(flat) == most:
            break
    return (flat + others)[:most]


def stable_poses(vertices: NDArray[np.float64]) -> list[dict[str, object]]:
    """Return resting poses for information, the likeliest first: probability, tilt from +z (deg), which way is up.

    After Goldberg et al., as implemented by trimesh, without randomness.
    """
    poses = []
    for up, probability in resting_ups(vertices)[:12]:
        if probability <= 0.02:
            break
        poses.append(
            {
                "probability": round(float(probability), 4),
                "tilt_degrees": round(float(np.degrees(np.arccos(np.clip(up[2], -1, 1)))), 2),
                "up": [round(float(value), 4) for value in up],
            }
        )
    return poses
