"""Hand and object as arrays of the energy kernel: points in blocks with bounding spheres, shapes, distances."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from pipeline.compute.warp import warp
from pipeline.energy import kernel
from pipeline.energy.keep_out import keep_out_points
from pipeline.hand.model import Hand
from pipeline.hand.surface import hand_surface, mount_surface
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.hand import PALM
from pipeline.records.parameters.synthesize import EnergyParameters, StyleParameters

BLOCK = 32  # points with one bounding sphere


def block_order(points: NDArray[np.float64]) -> list[NDArray[np.int64]]:
    """Split points (n, 3) into blocks of at most ``BLOCK`` neighbours by halving the longest side again and again."""
    blocks: list[NDArray[np.int64]] = []

    def split(indices: NDArray[np.int64]) -> None:
        if len(indices) <= BLOCK:
            blocks.append(indices)
            return
        axis = int(np.ptp(points[indices], axis=0).argmax())
        ordered = indices[np.argsort(points[indices, axis], kind="stable")]
        # A multiple of the block size on the left keeps all blocks but one full.
        half = BLOCK * max(1, round(len(indices) / (2 * BLOCK)))
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


def _put(arrays: Any, device: str, **fields: tuple[Any, Any]) -> None:
    """Set array fields of a struct of the kernel, each given by its values and the type of an element."""
    for name, (values, dtype) in fields.items():
        number = np.int32 if dtype is int else np.float32
        setattr(arrays, name, warp().array(np.ascontiguousarray(values, dtype=number), dtype=dtype, device=device))


def _put_blocks(
    arrays: Any, device: str, points: NDArray[np.float64], blocks: list[NDArray[np.int64]], prefix: str, block: str
) -> None:
    """Set points (n, 3) sorted into blocks (field ``<prefix>points``), and what bounds them (``<block>_centre``...)."""
    spheres = [bounding_sphere(points[own]) for own in blocks]
    fields = {
        f"{prefix}points": (points[np.concatenate([[], *blocks]).astype(np.int64)], wp.vec3),
        f"{block}_start": (np.cumsum([0, *(len(own) for own in blocks)]), int),
        f"{block}_centre": (np.array([centre for centre, _ in spheres]).reshape(-1, 3), wp.vec3),
        f"{block}_radius": ([radius for _, radius in spheres], float),
    }
    _put(arrays, device, **fields)


@lru_cache(maxsize=4)
def hand_arrays(
    hand: Hand, device: str, point_count: int, with_mount: bool, keep_out_for: tuple[str, ...] | None
) -> Any:
    """Return ``kernel.HandArrays`` of the hand with ``point_count`` surface points.

    Args:
        with_mount: whether flange and mount are part of it.
        keep_out_for: fingers of the style whose keep-out points are part of it, None for no such points.
    """
    parts = hand_parts(hand)
    arrays = kernel.HandArrays()
    arrays.link_count, arrays.part_count = len(hand.link_names), len(parts.link)
    _put(
        arrays,
        device,
        parent=(hand.parent, int),
        joint=(hand.joint, int),
        multiplier=(hand.multiplier, float),
        offset=(hand.offset, float),
        slides=(hand.slides, int),
        follows=(hand.follows, int),
        origin_rotation=(hand.origin[:, :3, :3], wp.mat33),
        origin_position=(hand.origin[:, :3, 3], wp.vec3),
        axis=(hand.axis, wp.vec3),
        lower=(hand.lower, float),
        upper=(hand.upper, float),
        part_link=(parts.link, int),
        part_centre=(parts.centre, wp.vec3),
        part_half=(parts.half, wp.vec3),
        part_radius=(parts.radius, float),
        part_reach=(np.linalg.norm(parts.half, axis=1) + parts.radius, float),
        contact_link=(hand.contact_link, int),
        contact_point=(hand.contact_points, wp.vec3),
        contact_opposes=([finger in hand.opposing for finger in hand.contact_finger], int),
    )
    _put_surface(arrays, device, hand, parts, point_count)
    mount = mount_surface(hand) if with_mount else np.zeros((1, 3))
    mount_centre, mount_radius = bounding_sphere(mount)
    _put(arrays, device, mount_points=(mount, wp.vec3))
    arrays.mount_count = len(mount) if with_mount else 0
    arrays.mount_centre, arrays.mount_radius = wp.vec3(*mount_centre.tolist()), mount_radius
    keep_out = np.zeros((0, 3)) if keep_out_for is None else keep_out_points(keep_out_for, hand)
    blocks = block_order(keep_out)
    _put_blocks(arrays, device, keep_out, blocks, "keep_out_", "keep_out")
    staying_out = [
        hand.link(name) for finger in keep_out_for or () if finger != PALM for name in hand.finger_links[finger]
    ]
    own_parts = np.flatnonzero(np.isin(parts.link, staying_out))
    _put(arrays, device, own_part=(own_parts, int))
    arrays.keep_out_blocks, arrays.own_count = len(blocks), len(own_parts)
    return arrays


def _put_surface(arrays: Any, device: str, hand: Hand, parts: HandParts, point_count: int) -> None:
    """Set the hand's own points, link by link, and the parts that they must not enter."""
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
    _put_blocks(arrays, device, points, order, "", "block")
    _put(
        arrays,
        device,
        link_block=(link_block, int),
        link_centre=(link_centre, wp.vec3),
        link_radius=(link_radius, float),
        link_other=(link_other, int),
        other_part=(other_part, int),
    )


def torque_scale(extents: NDArray[np.float64], scale: bool) -> float:
    """Return what torques are multiplied by: one over half the middle extent (1/m), or 1 as published."""
    return 2.0 / float(np.sort(extents)[1]) if scale else 1.0


def object_arrays(device: str, prepared: PreparedObject, energy: EnergyParameters, style: StyleParameters) -> Any:
    """Return ``kernel.ObjectArrays``; the object stands on a plane at its lowest z."""
    points = prepared.surface_points[: energy.object_points]
    blocks = block_order(points)
    top = prepared.distance_origin + prepared.distance_spacing * (np.array(prepared.distance.shape) - 1)
    padding = min((prepared.vertices.min(0) - prepared.distance_origin).min(), (top - prepared.vertices.max(0)).min())
    arrays = kernel.ObjectArrays()
    _put(arrays, device, distance=(prepared.distance, float))
    arrays.distance_origin = wp.vec3(*prepared.distance_origin.tolist())
    arrays.distance_spacing = prepared.distance_spacing
    arrays.padding = float(padding)
    _put_blocks(arrays, device, points, blocks, "", "block")
    arrays.block_count = len(blocks)
    arrays.torque_scale = torque_scale(prepared.extents, energy.scale_torque)
    arrays.table_height = prepared.bottom + style.table_clearance
    arrays.mount_height = prepared.bottom + (style.mount_clearance or 0.0)
    arrays.keep_out_margin = style.keep_out_margin or 0.0
    return arrays
