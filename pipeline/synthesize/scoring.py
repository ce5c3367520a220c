"""Final scores of synthesized grasps against the exact mesh, and the filter that names what a grasp fails."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.energy.arrays import torque_scale
from pipeline.energy.contacts import contact_positions, contact_shares, force_closure
from pipeline.energy.scene import Grasps
from pipeline.hand.model import Hand
from pipeline.records.energy_terms import Terms, weights
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.synthesize import EnergyParameters, StyleParameters
from pipeline.records.synthesis_reasons import SynthesisReason
from pipeline.shapes.rays import ray_scene

SURFACE_TOLERANCE = 1e-6  # m; nearer than this, the normal is that of the triangle
# A grasp is a duplicate of a better one within all three (notes of the yield measurements).
SAME_POSITION, SAME_ROTATION, SAME_JOINT = 0.01, np.deg2rad(15.0), 0.2


class ExactSurface:
    """Distance and normals of the prepared mesh itself, without a grid."""

    def __init__(self, prepared: PreparedObject) -> None:
        self._scene = ray_scene((prepared.vertices, prepared.faces))

    def distance_and_normal(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return signed distances (n,), positive outside, and outward unit normals (n, 3) of points (n, 3).

        The normal points from the closest surface point to the point (outside) or back (inside), which at an edge lies
        between the normals of its faces.
        """
        query = np.ascontiguousarray(points, dtype=np.float32)
        closest = self._scene.compute_closest_points(query)
        sign = np.where(self._scene.compute_occupancy(query, nthreads=1).numpy() > 0.5, -1.0, 1.0)
        away = points - closest["points"].numpy().astype(np.float64)
        distance = np.linalg.norm(away, axis=1)
        near = distance < SURFACE_TOLERANCE
        normal = np.where(near[:, None], 0.0, sign[:, None] * away / np.maximum(distance, SURFACE_TOLERANCE)[:, None])
        normal[near] = closest["primitive_normals"].numpy().astype(np.float64)[near]
        return sign * distance, normal / np.linalg.norm(normal, axis=1, keepdims=True)


def score_exactly(
    hand: Hand,
    prepared: PreparedObject,
    energy: EnergyParameters,
    style: StyleParameters,
    grasps: Grasps,
    terms: Terms,
) -> tuple[Terms, NDArray[np.float64], NDArray[np.float64]]:
    """Return terms with force closure, distance and energy taken from the mesh, contact points and normals (B, n, 3).

    The others do not use the distance grid, so they are exact already; but for the keep-out term, which only steers.
    """
    points = contact_positions(hand, grasps)
    distance, normals = ExactSurface(prepared).distance_and_normal(points.reshape(-1, 3))
    normals = normals.reshape(points.shape)
    shares = contact_shares(hand, grasps.contacts, energy.balance_forces)
    closure = force_closure(points, normals, shares, torque_scale(prepared.extents, energy.scale_torque))
    exact = replace(terms, force_closure=closure, distance=np.abs(distance.reshape(points.shape[:2])).sum(1))
    return exact.weighted(weights(energy, style)), points, normals


def first_failures(terms: Terms, energy: EnergyParameters) -> NDArray[np.str_]:
    """Return per grasp the first check that it fails, '' if none; a term that is not a number fails."""

    def limit(value: float | None) -> float:
        return np.inf if value is None else value

    checks = {
        SynthesisReason.JOINTS: ~(terms.joints <= limit(energy.limit_joints)),
        SynthesisReason.DISTANCE: ~(terms.distance <= energy.limit_distance),
        SynthesisReason.FORCE_CLOSURE: ~(terms.force_closure <= energy.limit_force_closure),
        SynthesisReason.PENETRATION: ~(terms.penetration <= energy.limit_penetration),
        SynthesisReason.TABLE: ~(terms.penetration + terms.table <= energy.limit_penetration),
        SynthesisReason.SELF_PENETRATION: ~(terms.self_penetration <= limit(energy.limit_self_penetration)),
    }
    reasons = np.full(len(terms.energy), "", dtype="<U32")
    for reason, failed in checks.items():
        reasons[(reasons == "") & failed] = reason.value
    return reasons


def duplicates(grasps: Grasps, energies: NDArray[np.float64], eligible: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which eligible grasps lie within 1 cm, 15 degrees and 0.2 rad per joint of a kept one of lower energy."""
    order = np.flatnonzero(eligible)[np.argsort(energies[eligible], kind="stable")]
    rotations = Rotation.from_quat(grasps.rotation, scalar_first=True)
    quaternions = rotations.as_quat(scalar_first=True)
    kept: list[int] = []
    duplicate = np.zeros(len(grasps), dtype=bool)
    for index in order:
        rivals = np.array(kept, dtype=np.int64)
        near = np.linalg.norm(grasps.position[rivals] - grasps.position[index], axis=1) < SAME_POSITION
        near &= np.abs(grasps.q[rivals] - grasps.q[index]).max(axis=1, initial=0.0) < SAME_JOINT
        cosine = np.abs(quaternions[rivals] @ quaternions[index])
        near &= 2 * np.arccos(np.minimum(cosine, 1.0)) < SAME_ROTATION
        duplicate[index] = near.any()
        if not duplicate[index]:
            kept.append(int(index))
    return duplicate
