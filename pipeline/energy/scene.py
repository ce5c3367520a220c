"""Numpy's door to the energy kernel: arrays of hand and object, batches of grasps, evaluation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.compute.warp import warp
from pipeline.energy.keep_out import fingers_used, keep_out_points
from pipeline.hand.model import Hand
from pipeline.hand.surface import hand_surface, mount_surface
from pipeline.records.errors import UserError
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.hand import PALM
from pipeline.records.parameters.synthesize import EnergyParameters, StyleParameters

BLOCK = 32  # points with one bounding sphere
PALM_WEIGHT = 3.0  # chance of the palm in a contact draw, relative to one link of a finger (released code)


@dataclass
class Grasps:
    """A batch of grasps; object frame, SI units."""

    position: NDArray[np.float64]  # (B, 3) of the hand frame's origin
    rotation: NDArray[np.float64]  # (B, 4) wxyz
    q: NDArray[np.float64]  # (B, J)
    contacts: NDArray[np.int64]  # (B, n) indices into Hand.contact_points

    def __len__(self) -> int:
        return len(self.position)


@dataclass(frozen=True)
class Terms:
    """Unweighted energy terms of a batch, each (B,)."""

    energy: NDArray[np.float64]
    force_closure: NDArray[np.float64]
    distance: NDArray[np.float64]
    penetration: NDArray[np.float64]
    table: NDArray[np.float64]
    self_penetration: NDArray[np.float64]
    joints: NDArray[np.float64]
    offset: NDArray[np.float64]
    keep_out: NDArray[np.float64]


def block_order(points: NDArray[np.float64], size: int = BLOCK) -> list[NDArray[np.int64]]:
    """Split points (n, 3) into blocks of at most ``size`` neighbours by halving the longest side again and again."""
    blocks: list[NDArray[np.int64]] = []

    def split(indices: NDArray[np.int64]) -> None:
        if len(indices) <= size:
            blocks.append(indices)
            return
        axis = int(np.ptp(points[indices], axis=0).argmax())
        ordered = indices[np.argsort(points[indices, axis], kind="stable")]
        # A multiple of the block size on the left keeps all blocks but one full.
        half = size * max(1, round(len(indices) / (2 * size)))
        split(ordered[:half])
        split(ordered[half:])

    if len(points):
        split(np.arange(len(points)))
    return blocks


def bounding_sphere(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Return centre (3,) and radius of a sphere about points (n, 3), centred in their box."""
    centre = (points.min(0) + points.max(0)) / 2
    return centre, float(np.linalg.norm(points - centre, axis=1).max()) + 1e-6


def neighbours(hand: Hand) -> set[tuple[int, int]]:
    """Pairs of links that may overlap: each with itself, parents with children, and those that the hand names."""
    pairs = {(link, link) for link in range(len(hand.link_names))}
    joined = [(link, int(parent)) for link, parent in enumerate(hand.parent) if parent >= 0]
    joined += [(hand.link(one), hand.link(other)) for one, other in hand.may_overlap]
    for a, b in joined:
        pairs |= {(a, b), (b, a)}
    return pairs


@dataclass(frozen=True)
class HandParts:
    """Boxes, then spheres, of the hand as one list."""

    link: NDArray[np.int64]
    centre: NDArray[np.float64]  # (P, 3) link frame
    half: NDArray[np.float64]  # (P, 3), 0 for spheres
    radius: NDArray[np.float64]  # (P,), 0 for boxes


def hand_parts(hand: Hand) -> HandParts:
    """Return the collision shapes of the hand; its boxes must not be turned in their link frames."""
    if not np.allclose(hand.box_pose[:, :3, :3], np.eye(3)):
        raise ValueError("the energy kernel expects boxes that are not turned in their link frames")
    spheres = len(hand.sphere_link)
    return HandParts(
        link=np.concatenate([hand.box_link, hand.sphere_link]),
        centre=np.concatenate([hand.box_pose[:, :3, 3], hand.sphere_centre]),
        half=np.concatenate([hand.box_half, np.zeros((spheres, 3))]),
        radius=np.concatenate([np.zeros(len(hand.box_link)), hand.sphere_radius]),
    )


@lru_cache(maxsize=4)
def hand_arrays(
    hand: Hand, device: str, point_count: int, with_mount: bool, keep_out_for: tuple[str, ...] | None
) -> Any:
    """Return ``kernel.HandArrays`` of the hand with ``point_count`` surface points.

    Args:
        with_mount: whether flange and mount are part of it.
        keep_out_for: fingers of the style whose keep-out points are part of it, None for no such points.
    """
    wp = warp()
    from pipeline.energy import kernel

    parts = hand_parts(hand)
    owners, points = hand_surface(point_count, hand)
    apart = neighbours(hand)
    order: list[NDArray[np.int64]] = []
    link_block, link_centre, link_radius, link_other, other_part = [0], [], [], [0], []
    for link in range(len(hand.link_names)):
        own = np.flatnonzero(owners == link)
        order += [own[block] for block in block_order(points[own])]
        link_block.append(len(order))
        centre, radius = bounding_sphere(points[own]) if len(own) else (np.zeros(3), 0.0)
        link_centre.append(centre)
        link_radius.append(radius)
        other_part += [part for part, other in enumerate(parts.link) if (link, int(other)) not in apart]
        link_other.append(len(other_part))
    spheres = [bounding_sphere(points[block]) for block in order]
    mount = mount_surface(hand) if with_mount else np.zeros((1, 3))
    mount_centre, mount_radius = bounding_sphere(mount)
    arrays = kernel.HandArrays()

    def put(name: str, values: Any, dtype: Any) -> None:
        number = np.int32 if dtype is int else np.float32
        setattr(arrays, name, wp.array(np.ascontiguousarray(values, dtype=number), dtype=dtype, device=device))

    arrays.link_count, arrays.part_count = len(hand.link_names), len(parts.link)
    put("parent", hand.parent, int)
    put("joint", hand.joint, int)
    put("origin_rotation", hand.origin[:, :3, :3], wp.mat33)
    put("origin_position", hand.origin[:, :3, 3], wp.vec3)
    put("axis", hand.axis, wp.vec3)
    put("lower", hand.lower, float)
    put("upper", hand.upper, float)
    put("part_link", parts.link, int)
    put("part_centre", parts.centre, wp.vec3)
    put("part_half", parts.half, wp.vec3)
    put("part_radius", parts.radius, float)
    put("part_reach", np.linalg.norm(parts.half, axis=1) + parts.radius, float)
    put("points", points[np.concatenate(order)], wp.vec3)
    put("block_start", np.cumsum([0, *(len(block) for block in order)]), int)
    put("block_centre", [centre for centre, _ in spheres], wp.vec3)
    put("block_radius", [radius for _, radius in spheres], float)
    put("link_block", link_block, int)
    put("link_centre", link_centre, wp.vec3)
    put("link_radius", link_radius, float)
    put("link_other", link_other, int)
    put("other_part", other_part, int)
    put("mount_points", mount, wp.vec3)
    arrays.mount_count = len(mount) if with_mount else 0
    arrays.mount_centre, arrays.mount_radius = wp.vec3(*mount_centre.tolist()), mount_radius
    keep_out = np.zeros((0, 3)) if keep_out_for is None else keep_out_points(keep_out_for, hand)
    blocks = block_order(keep_out)
    spheres = [bounding_sphere(keep_out[block]) for block in blocks]
    put("keep_out_points", keep_out[np.concatenate([[], *blocks]).astype(np.int64)], wp.vec3)
    put("keep_out_start", np.cumsum([0, *(len(block) for block in blocks)]), int)
    put("keep_out_centre", np.array([centre for centre, _ in spheres]).reshape(-1, 3), wp.vec3)
    put("keep_out_radius", [radius for _, radius in spheres], float)
    staying_out = [
        hand.link(name) for finger in keep_out_for or () if finger != PALM for name in hand.finger_links[finger]
    ]
    own_parts = np.flatnonzero(np.isin(parts.link, staying_out))
    put("own_part", own_parts, int)
    arrays.keep_out_blocks, arrays.own_count = len(blocks), len(own_parts)
    put("contact_link", hand.contact_link, int)
    put("contact_point", hand.contact_points, wp.vec3)
    put("contact_opposes", [finger in hand.opposing for finger in hand.contact_finger], int)
    return arrays


def torque_scale(extents: NDArray[np.float64], scale: bool) -> float:
    """Return what torques are multiplied by: one over half the middle extent (1/m), or 1 as published."""
    return 2.0 / float(np.sort(extents)[1]) if scale else 1.0


def object_arrays(device: str, prepared: PreparedObject, energy: EnergyParameters, style: StyleParameters) -> Any:
    """Return ``kernel.ObjectArrays``; the object stands on a plane at its lowest z."""
    wp = warp()
    from pipeline.energy import kernel

    points = prepared.surface_points[: energy.object_points]
    blocks = block_order(points)
    spheres = [bounding_sphere(points[block]) for block in blocks]
    top = prepared.distance_origin + prepared.distance_spacing * (np.array(prepared.distance.shape) - 1)
    padding = min((prepared.vertices.min(0) - prepared.distance_origin).min(), (top - prepared.vertices.max(0)).min())
    arrays = kernel.ObjectArrays()
    arrays.distance = wp.array(np.ascontiguousarray(prepared.distance), dtype=float, device=device)
    arrays.distance_origin = wp.vec3(*prepared.distance_origin.tolist())
    arrays.distance_spacing = prepared.distance_spacing
    arrays.padding = float(padding)

    def put(name: str, values: Any, dtype: Any) -> None:
        number = np.int32 if dtype is int else np.float32
        setattr(arrays, name, wp.array(np.ascontiguousarray(values, dtype=number), dtype=dtype, device=device))

    put("points", points[np.concatenate(blocks)], wp.vec3)
    put("block_start", np.cumsum([0, *(len(block) for block in blocks)]), int)
    put("block_centre", [centre for centre, _ in spheres], wp.vec3)
    put("block_radius", [radius for _, radius in spheres], float)
    arrays.block_count = len(blocks)
    arrays.torque_scale = torque_scale(prepared.extents, energy.scale_torque)
    arrays.table_height = prepared.bottom + style.table_clearance
    arrays.mount_height = prepared.bottom + (style.mount_clearance or 0.0)
    arrays.keep_out_margin = style.keep_out_margin or 0.0
    return arrays


def compile_kernels(device: str = "cpu") -> None:
    """Compile the kernels for a device, or load them from Warp's cache."""
    from pipeline.energy import kernel

    warp().load_module(kernel, device=device)


class EnergyScene:
    """One object in one style on one device, ready to evaluate and move grasps."""

    def __init__(
        self,
        prepared: PreparedObject,
        energy: EnergyParameters,
        style: StyleParameters,
        hand: Hand,
        device: str = "cpu",
    ) -> None:
        """Put ``prepared`` before ``hand``."""
        self.wp = warp()
        from pipeline.energy import kernel

        self.kernel = kernel
        self.device = device
        keep_out_for = None if style.keep_out_margin is None else fingers_used(style.finger_sets)
        self.joint_count = hand.joint_count
        self.hand = hand_arrays(hand, device, energy.hand_points, style.mount_clearance is not None, keep_out_for)
        self.scene = object_arrays(device, prepared, energy, style)
        self.energy = energy

    def weights(self, table_factor: int = 1) -> Any:
        """Return ``kernel.Weights``; the gradient of the table term is multiplied by ``table_factor``."""
        weights = self.kernel.Weights()
        weights.force_closure = self.energy.weight_force_closure
        weights.distance = self.energy.weight_distance
        weights.penetration = self.energy.weight_penetration
        weights.table_slope = self.energy.weight_penetration * table_factor
        weights.self_penetration = self.energy.weight_self_penetration
        weights.joints = self.energy.weight_joints
        weights.offset = self.energy.weight_offset
        weights.balance_forces = int(self.energy.balance_forces)
        return weights

    def states(self, grasps: Grasps) -> Any:
        """Return ``kernel.States`` holding a batch; energies and gradients are still zero."""
        wp, count = self.wp, len(grasps)
        states = self.kernel.States()
        states.position = wp.array(grasps.position.astype(np.float32), dtype=wp.vec3, device=self.device)
        xyzw = np.roll(grasps.rotation, -1, axis=1)
        states.rotation = wp.array(xyzw.astype(np.float32), dtype=wp.quat, device=self.device)
        states.q = wp.array(grasps.q.astype(np.float32), dtype=float, device=self.device)
        states.contacts = wp.array(grasps.contacts.astype(np.int32), dtype=int, device=self.device)
        states.terms = wp.zeros((count, self.kernel.TERMS), dtype=float, device=self.device)
        states.energy = wp.zeros(count, dtype=float, device=self.device)
        states.gradient = wp.zeros((count, self.kernel.POSE + self.joint_count), dtype=float, device=self.device)
        return states

    def scratch(self, grasps: Grasps) -> Any:
        """Return working memory for a batch."""
        wp, count, scratch = self.wp, len(grasps), self.kernel.Scratch()
        links, parts = self.hand.link_count, self.hand.part_count
        scratch.rotation = wp.zeros((count, links), dtype=wp.mat33, device=self.device)
        for name in ("position", "force", "moment"):
            setattr(scratch, name, wp.zeros((count, links), dtype=wp.vec3, device=self.device))
        scratch.part_position = wp.zeros((count, parts), dtype=wp.vec3, device=self.device)
        scratch.near = wp.zeros((count, parts), dtype=int, device=self.device)
        scratch.normal = wp.zeros((count, grasps.contacts.shape[1]), dtype=wp.vec3, device=self.device)
        return scratch

    def launch_evaluation(self, states: Any, scratch: Any, weights: Any) -> None:
        """Compute terms, energies and gradients of states in place."""
        self.wp.launch(
            self.kernel.evaluate_kernel,
            dim=states.energy.shape[0],
            inputs=[self.hand, self.scene, weights, states, scratch],
            device=self.device,
        )

    def evaluate(self, grasps: Grasps) -> tuple[Terms, NDArray[np.float64]]:
        """Return terms and gradients (B, 6 + J) of a batch; degrees of freedom as in ``kernel``."""
        states = self.states(grasps)
        self.launch_evaluation(states, self.scratch(grasps), self.weights())
        return read_terms(states), states.gradient.numpy().astype(np.float64)


def read_terms(states: Any) -> Terms:
    """Return the terms held by states."""
    return Terms(states.energy.numpy().astype(np.float64), *states.terms.numpy().astype(np.float64).T)


def read_grasps(states: Any) -> Grasps:
    """Return the grasps held by states."""
    return Grasps(
        position=states.position.numpy().astype(np.float64),
        rotation=np.roll(states.rotation.numpy().astype(np.float64), 1, axis=1),
        q=states.q.numpy().astype(np.float64),
        contacts=states.contacts.numpy().astype(np.int64),
    )


def chosen(grasps: Grasps, rows: Sequence[int] | NDArray[np.int64]) -> Grasps:
    """Return some grasps of a batch, in the order of ``rows``."""
    index = np.asarray(rows, dtype=np.int64)
    return Grasps(grasps.position[index], grasps.rotation[index], grasps.q[index], grasps.contacts[index])


def contact_positions(hand: Hand, grasps: Grasps) -> NDArray[np.float64]:
    """Return contact points (B, n, 3) on the hand, object frame."""
    from pipeline.hand.kinematics import link_poses

    T = link_poses(hand, grasps.q)
    rows = np.arange(len(grasps))[:, None]
    own = T[rows, hand.contact_link[grasps.contacts]]
    in_hand = np.einsum("bnij,bnj->bni", own[..., :3, :3], hand.contact_points[grasps.contacts]) + own[..., :3, 3]
    R = Rotation.from_quat(grasps.rotation, scalar_first=True).as_matrix()
    return np.einsum("bij,bnj->bni", R, in_hand) + grasps.position[:, None]


def contact_shares(hand: Hand, contacts: NDArray[np.int64], balance: bool) -> NDArray[np.float64]:
    """Return the force share (B, n) of contacts (B, n): both opposing groups carry half, or 1 each as published."""
    opposing = np.array([finger in hand.opposing for finger in hand.contact_finger])[contacts]
    count = contacts.shape[1]
    mine = np.where(opposing, opposing.sum(1, keepdims=True), (~opposing).sum(1, keepdims=True))
    both = opposing.any(1, keepdims=True) & (~opposing).any(1, keepdims=True)
    return np.where(both, 0.5 * count / mine, 1.0) if balance else np.ones(contacts.shape)


def force_closure(
    points: NDArray[np.float64], normals: NDArray[np.float64], shares: NDArray[np.float64], scale: float
) -> NDArray[np.float64]:
    """Return |sum of share (n; scale x cross n)|^2 (B,) of contacts (B, n, 3): differentiable force closure.

    Source: the published energy, with a share per contact and torques scaled by the object's size.
    """
    forces = shares[..., None] * normals
    wrench = np.concatenate([forces.sum(1), scale * np.cross(points, forces).sum(1)], axis=-1)
    return (wrench**2).sum(-1)


def contact_slots(
    hand: Hand, fingers: Sequence[str], count: int, links: Sequence[str] = (), free: bool = False
) -> list[NDArray[np.float64]]:
    """Return, per contact, the chance (C,) of every candidate.

    The first contacts belong to one finger of the set each, so that every finger has one; further contacts are drawn
    from all fingers of the set. Links have equal chances, the palm three times that (released code).

    Args:
        count: number of contacts, at least one per finger.
        links: names of the links that may touch, all of the fingers' when empty.
        free: draw every contact from all fingers, as the released code does.

    Raises:
        UserError: a link is not of these fingers, or a finger has no link with contact candidates.
    """
    key = "+".join(fingers)
    unknown = sorted(set(links) - {link for finger in fingers for link in hand.finger_links[finger]})
    if unknown:
        raise UserError(
            f"params.yaml: links of {key} names {unknown[0]!r}, which is no link of these fingers; remove it there."
        )
    weights = np.zeros(len(hand.contact_link))
    for finger in fingers:
        touching = [link for link in hand.finger_links[finger] if link in links or not links]
        for own in (hand.contact_link == hand.link(link) for link in touching):
            if own.any():
                weights[own] = (PALM_WEIGHT if finger == PALM else 1.0) / own.sum()
        if not weights[np.array(hand.contact_finger) == finger].any():
            raise UserError(f"params.yaml: links of {key} leaves the {finger} no contact; name one of its links there.")
    slots = []
    for slot in range(count):
        own = weights.copy()
        if slot < len(fingers) and not free:
            own[np.array(hand.contact_finger) != fingers[slot]] = 0.0
        slots.append(own / own.sum())
    return slots
