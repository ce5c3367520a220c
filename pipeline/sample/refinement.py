"""Samples moved a little so that they touch what they should and overlap nothing: the grasp energy of both objects.

The state of a two-object grasp has 12 + J degrees of freedom: the hand's pose in the frame of either object (6 each,
see ``pipeline.energy.kernel``) and the joints. Its energy is that of the pinch grasp of object 0, that of the side
grasp of object 1, and the overlap of the two objects. Steps go down the gradient, every degree of freedom scaled by the
running root mean square of its own slope, and grow shorter; the best state is kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.energy.scene import EnergyScene, Grasps
from pipeline.hand.model import Hand
from pipeline.model.representation import GraspBatch
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.synthesize import EnergyParameters, StyleParameters
from pipeline.records.poses import inverse_pose, position_quaternion, transform_points
from pipeline.sample.contacts import Contacts, choose_contacts
from pipeline.shapes.distance_field import DistanceField

POSE = 6
MEMORY = 0.9  # of the mean squared slope
OVERLAP_POINTS = 512  # surface points of each object that are looked at
ROUNDS = 2  # how often contacts are chosen anew on the way


@dataclass(frozen=True)
class Scored:
    """Grasps with what is known of them."""

    grasps: GraspBatch
    contacts: tuple[Contacts, Contacts]
    energy: NDArray[np.float64]  # (B,) weighted, both objects and their overlap
    penetration: NDArray[np.float64]  # (B,) m, the kernel's sum over surface points, larger of both objects
    overlap: NDArray[np.float64]  # (B,) m, deepest point of one object inside the other

    def chosen(self, index: NDArray[np.int64]) -> Scored:
        """Return some of the grasps, in the given order."""
        first, second = self.contacts
        return Scored(
            self.grasps[index],
            (first.chosen(index), second.chosen(index)),
            self.energy[index],
            self.penetration[index],
            self.overlap[index],
        )


class PairEnergy:
    """Energy and gradient of two-object grasps of one pair."""

    def __init__(
        self,
        objects: tuple[PreparedObject, PreparedObject],
        energy: EnergyParameters,
        styles: tuple[StyleParameters, StyleParameters],
        clearance: float,
        hand: Hand,
    ) -> None:
        self.hand = hand
        self.objects, self.settings, self.styles, self.clearance = objects, energy, styles, clearance
        self.scenes = [EnergyScene(item, energy, style, hand) for item, style in zip(objects, styles, strict=True)]
        self.fields = [DistanceField(item) for item in objects]

    def contacts(self, grasps: GraspBatch, rng: np.random.Generator) -> tuple[Contacts, Contacts]:
        """Choose the contacts of both objects."""
        T = inverse_pose(grasps.T_hand_object)
        first, second = (
            choose_contacts(self.hand, self.objects[slot], self.fields[slot], T[:, slot], grasps.q, self.settings,
                            self.styles[slot], rng)
            for slot in (0, 1)
        )  # fmt: skip
        return first, second

    def evaluate(
        self, grasps: GraspBatch, contacts: tuple[Contacts, Contacts]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return energies (B,), gradients (B, 12 + J), penetration (B,) and overlap (B,), m.

        Degrees of freedom: pose in the frame of object 0, pose in that of object 1, joints; rotations in hand axes.
        """
        T_object_hand = inverse_pose(grasps.T_hand_object)
        energy, gradient = np.zeros(len(grasps)), np.zeros((len(grasps), 2 * POSE + self.hand.joint_count))
        penetration = np.zeros(len(grasps))
        for slot, scene in enumerate(self.scenes):
            position, quaternion = position_quaternion(T_object_hand[:, slot])
            own = contacts[slot].candidates
            counts = np.array([len(row) for row in own])
            for count in np.unique(counts):  # the kernel takes grasps with equally many contacts
                rows = np.flatnonzero(counts == count)
                batch = Grasps(position[rows], quaternion[rows], grasps.q[rows], np.stack([own[row] for row in rows]))
                terms, slopes = scene.evaluate(batch)
                energy[rows] += terms.energy
                penetration[rows] = np.maximum(penetration[rows], terms.penetration)
                gradient[rows, slot * POSE : (slot + 1) * POSE] += slopes[:, :POSE]
                gradient[rows, 2 * POSE :] += slopes[:, POSE:]
        overlap = np.zeros(len(grasps))
        for slot in (0, 1):
            deepest = self._overlap(T_object_hand, slot, energy, gradient)
            overlap = np.maximum(overlap, deepest)
        return energy, gradient, penetration, overlap

    def _overlap(
        self,
        T_object_hand: NDArray[np.float64],
        slot: int,
        energy: NDArray[np.float64],
        gradient: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Add energy and slopes of the other object's points that are nearer to this object than the clearance.

        Returns the deepest point (B,), m, 0 where nothing overlaps. A point p of the other object lies at
        y = R_other^T (p - t_other) in the hand frame and at x = R y + t in this object's.
        """
        other = 1 - slot
        R, R_other = T_object_hand[:, slot, :3, :3], T_object_hand[:, other, :3, :3]
        points = self.objects[other].surface_points[:OVERLAP_POINTS]
        y = (points - T_object_hand[:, other, None, :3, 3]) @ R_other
        x = transform_points(T_object_hand[:, slot], y)
        low = self.objects[slot].vertices.min(0) - self.clearance
        high = self.objects[slot].vertices.max(0) + self.clearance
        grasp, point = np.nonzero(((x > low) & (x < high)).all(-1))
        deepest = np.zeros(len(x))
        if not len(grasp):
            return deepest
        distance, normal = self.fields[slot].look_up(x[grasp, point])
        depth = self.clearance - distance
        near = depth > 0
        grasp, point, depth, normal = grasp[near], point[near], depth[near], normal[near]
        np.maximum.at(deepest, grasp, -distance[near])
        weight = self.settings.weight_penetration
        np.add.at(energy, grasp, weight * depth)
        slope = -weight * normal  # derivative by x
        in_hand = np.einsum("nij,ni->nj", R[grasp], slope)  # R^T slope
        turn = np.cross(y[grasp, point], in_hand)
        begin, begin_other = slot * POSE, other * POSE
        np.add.at(gradient[:, begin : begin + 3], grasp, slope)
        np.add.at(gradient[:, begin + 3 : begin + POSE], grasp, turn)
        np.add.at(gradient[:, begin_other : begin_other + 3], grasp, -np.einsum("nij,nj->ni", R_other[grasp], in_hand))
        np.add.at(gradient[:, begin_other + 3 : begin_other + POSE], grasp, -turn)
        return np.maximum(deepest, 0.0)

    def moved(self, grasps: GraspBatch, step: NDArray[np.float64]) -> GraspBatch:
        """Return grasps displaced by steps (B, 12 + J), joints within limits."""
        T = inverse_pose(grasps.T_hand_object)
        for slot in (0, 1):
            begin = slot * POSE
            T[:, slot, :3, 3] += step[:, begin : begin + 3]
            T[:, slot, :3, :3] = (
                T[:, slot, :3, :3] @ Rotation.from_rotvec(step[:, begin + 3 : begin + POSE]).as_matrix()
            )
        q = np.clip(grasps.q + step[:, 2 * POSE :], self.hand.lower, self.hand.upper)
        return GraspBatch(inverse_pose(T), q)

    def score(self, grasps: GraspBatch, contacts: tuple[Contacts, Contacts]) -> Scored:
        """Return the grasps with their energies."""
        energy, _, penetration, overlap = self.evaluate(grasps, contacts)
        return Scored(grasps, contacts, energy, penetration, overlap)


def refine(
    pair: PairEnergy, grasps: GraspBatch, iterations: int, first_step: float, rng: np.random.Generator
) -> Scored:
    """Return the best states of a descent; with 0 iterations the grasps themselves, scored.

    Args:
        first_step: m and rad; the last step is zero.
    """
    contacts = pair.contacts(grasps, rng)
    if iterations == 0:
        return pair.score(grasps, contacts)
    for round_ in range(ROUNDS):
        count = iterations // ROUNDS if round_ else iterations - (ROUNDS - 1) * (iterations // ROUNDS)
        step = first_step * (0.5**round_)
        grasps = _descend(pair, grasps, contacts, count, step)
        contacts = pair.contacts(grasps, rng)
    return pair.score(grasps, contacts)


def _descend(
    pair: PairEnergy, grasps: GraspBatch, contacts: tuple[Contacts, Contacts], iterations: int, first_step: float
) -> GraspBatch:
    mean_square: NDArray[np.float64] | None = None
    best_energy = np.full(len(grasps), np.inf)
    best = grasps
    for iteration in range(iterations):
        energy, gradient, _, _ = pair.evaluate(grasps, contacts)
        better = energy < best_energy
        best_energy = np.where(better, energy, best_energy)
        best = GraspBatch(
            np.where(better[:, None, None, None], grasps.T_hand_object, best.T_hand_object),
            np.where(better[:, None], grasps.q, best.q),
        )
        square = gradient**2
        mean_square = square if mean_square is None else MEMORY * mean_square + (1 - MEMORY) * square
        step = first_step * (1 - iteration / iterations) * gradient / (np.sqrt(mean_square) + 1e-6)
        grasps = pair.moved(grasps, -step)
    return best
