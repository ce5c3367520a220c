"""Objects out of one depth picture: where the camera stands, and the points of every object that it sees."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pipeline.reconstruct.detection import seen_tags
from pipeline.reconstruct.fusion import Points
from pipeline.reconstruct.lens import Lens
from pipeline.reconstruct.surface import belongs_to, oriented
from pipeline.reconstruct.tag_cameras import LEAST_TAGS, pose_of
from pipeline.records.captures import Scene
from pipeline.records.errors import UserError
from pipeline.records.parameters.reconstruct import SurfaceParameters
from pipeline.records.poses import inverse_pose, transform_points
from pipeline.records.tag_layouts import TagLayout

LEAST_POINTS = 200  # of an object
MOST_POINTS = 4096  # farthest-point samples of an object, as of a reconstruction
PLANE_TOLERANCE, PLANE_TRIALS, PLANE_POINTS = 0.006, 1000, 10_000  # m, draws, and points they are drawn from
LEAST_PLANE = 0.2  # of all points, that lie in the support
LOWEST_LOOK = np.radians(10)  # of the camera towards the support
SCALE_TOLERANCE = 0.03  # by which depth and tags may disagree
NOISES = 3.0  # times the noise of the support, above which a point is not the support's


@dataclass(frozen=True)
class PartialCloud:
    """What one depth picture shows of an object.

    The object frame has its origin in the middle of the box's base, z up, turned by the object's yaw.
    """

    points: NDArray[np.float64]  # (n, 3), m
    normals: NDArray[np.float64]  # (n, 3) unit, towards the camera
    T_scene_object: NDArray[np.float64]  # (4, 4)


def read_depth(path: Path) -> NDArray[np.float64]:
    """Return a depth picture (h, w), m along the optical axis, 0 where unknown: not positive, or not finite.

    Whole numbers are millimetres, fractions metres.

    Raises:
        UserError: the file cannot be read, or is no depth picture.
    """
    try:
        if path.suffix.lower() == ".npy":
            stored = np.load(path, allow_pickle=False)
        else:
            with Image.open(path) as picture:
                stored = np.asarray(picture)
                eight_bits = picture.mode not in ("I;16", "I;16B", "I", "F")
            if eight_bits:
                raise UserError(f"{path} is no depth picture of 16 bits; save the depths as such, in millimetres.")
        whole = stored.dtype.kind in "iu"
        depth = np.asarray(stored, np.float64)
    except (OSError, EOFError, SyntaxError, TypeError, ValueError, MemoryError) as error:
        raise UserError(
            f"{path} is no depth picture ({error}); give a PNG of 16 bits in millimetres, or .npy in metres."
        ) from error
    if depth.ndim != 2:
        raise UserError(f"{path} has shape {depth.shape}; a depth picture has one number per pixel.")
    depth = depth / 1000 if whole else depth
    return np.where(np.isfinite(depth) & (depth > 0), depth, 0.0)


def lifted(depth: NDArray[np.float64], lens: Lens) -> NDArray[np.float64]:
    """Return the points (n, 3) of all known depths (h, w), camera frame: x right, y down, z ahead."""
    rows, columns = np.nonzero(depth)
    rays = lens.rays(np.stack([columns + 0.5, rows + 0.5], axis=1))
    return np.concatenate([rays, np.ones((len(rays), 1))], axis=1) * depth[rows, columns, None]


def pose_by_tags(
    grey: NDArray[np.uint8], layout: TagLayout, lens: Lens, depth: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return ``T_camera_scene`` (4, 4) by the tags in the photo (h, w) that belongs to a depth picture (h, w).

    Raises:
        UserError: it shows too few tags, the layout does not say where they lie, or the depths contradict them.
    """
    if layout.solved:
        raise UserError(
            "tags.yaml leaves it to the photos where the tags lie, and one cannot tell; give their places there."
        )
    placed = layout.corners()
    seen = {number: pixels for number, pixels in seen_tags(grey, layout).tags.items() if number in placed}
    if len(seen) < LEAST_TAGS:
        raise UserError(
            f"the photo shows {len(seen)} of the tags in tags.yaml; keep {LEAST_TAGS} or more in view, or leave out "
            "--photo and --tags: then the largest plane is taken for the support."
        )
    places, pixels = np.concatenate([placed[n] for n in seen]), np.concatenate(list(seen.values()))
    T = pose_of(lens, places, pixels)
    if T is None:
        raise UserError("the tags in the photo fit no camera; correct tags.yaml or the intrinsics.")
    rays = lens.rays(pixels)
    turn, shift = cv2.solvePnPRefineLM(
        places, rays, np.eye(3), np.zeros(4), cv2.Rodrigues(T[:3, :3])[0], T[:3, 3:].copy()
    )
    T[:3, :3], T[:3, 3] = cv2.Rodrigues(turn)[0], shift.ravel()
    _check_scale(depth, {n: (seen[n], (placed[n] @ T[:3, :3].T + T[:3, 3])[:, 2].mean()) for n in seen})
    return T


def _check_scale(depth: NDArray[np.float64], tags: Mapping[int, tuple[NDArray[np.float64], float]]) -> None:
    """Compare the depths (h, w) where the tags are with those of the tags.

    Args:
        tags: per tag its corners (4, 2), pixels, and its depth by the pose, m.
    """
    ratios = []
    for corners, distance in tags.values():
        (left, top), (right, bottom) = corners.min(axis=0).astype(int), corners.max(axis=0).astype(int)
        inside = depth[max(top, 0) : bottom + 1, max(left, 0) : right + 1]
        if (inside > 0).mean() > 0.5:
            ratios.append(float(np.median(inside[inside > 0])) / distance)
    if ratios and abs(np.median(ratios) - 1) > SCALE_TOLERANCE:
        raise UserError(
            f"the depths are {np.median(ratios):.3g} times those of the tags; correct the unit of the depths (whole "
            "numbers are millimetres, fractions metres), the tags' size, or the intrinsics."
        )


def pose_by_support(points: NDArray[np.float64], seed: int) -> NDArray[np.float64]:
    """Return ``T_camera_scene`` (4, 4) by the largest plane in points (n, 3) of the camera frame.

    The plane is z = 0, the camera above it. The origin is where the optical axis meets it, x points to the camera's
    right, and y away from the camera.

    Raises:
        UserError: no plane is large enough, or the camera does not look down at it.
    """
    generator = np.random.default_rng(seed)
    few = points[generator.permutation(len(points))[:PLANE_POINTS]]
    best = np.zeros(len(few), bool)
    for three in generator.integers(len(few), size=(PLANE_TRIALS, 3)) if len(few) >= 3 else ():
        a, b, c = few[three]
        normal = np.cross(b - a, c - a)
        if (length := float(np.linalg.norm(normal))) > 1e-9:
            inside = np.abs((few - a) @ (normal / length)) < PLANE_TOLERANCE
            best = inside if inside.sum() > best.sum() else best
    if best.sum() < max(LEAST_POINTS, LEAST_PLANE * len(few)):
        raise UserError(
            "the depths show no plane that is large enough for a support; let the picture show more of the table, or "
            "give --photo and --tags."
        )
    for _ in range(3):
        middle = few[best].mean(axis=0)
        up = np.linalg.svd(few[best] - middle, full_matrices=False)[2][2]
        best = np.abs((few - middle) @ up) < PLANE_TOLERANCE
    up = up if up @ middle < 0 else -up  # towards the camera, which is the origin
    if -up[2] < np.sin(LOWEST_LOOK):
        raise UserError("the camera hardly looks down at the largest plane; tilt it, or give --photo and --tags.")
    right = np.array([1.0, 0, 0]) - up[0] * up
    right /= np.linalg.norm(right)
    T = np.eye(4)
    T[:3, :3] = np.stack([right, np.cross(up, right), up], axis=1)
    T[:3, 3] = [0, 0, (up @ middle) / up[2]]
    return T


def _noise(heights: NDArray[np.float64]) -> float:
    """Return the spread (m) of the support's heights (n,): 1.48 times their median distance from their median."""
    near = heights[np.abs(heights) < 2 * PLANE_TOLERANCE]
    return 1.48 * float(np.median(np.abs(near - np.median(near)))) if len(near) else 0.0


def partial_clouds(
    points: NDArray[np.float64], T_camera_scene: NDArray[np.float64], scene: Scene, settings: SurfaceParameters
) -> dict[str, PartialCloud]:
    """Return what is seen of every object of a scene.

    Args:
        points: (n, 3), camera frame.

    Raises:
        UserError: too few points lie in the box of an object.
    """
    T_scene_camera = inverse_pose(T_camera_scene)
    positions = transform_points(T_scene_camera, points)
    clearance = max(settings.clearance, NOISES * _noise(positions[:, 2] - scene.support_plane))
    owner = belongs_to(positions, scene, settings.model_copy(update={"clearance": clearance}))
    towards = T_scene_camera[:3, 3] - positions
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    found = {}
    for number, (name, item) in enumerate(scene.objects.items()):
        own = owner == number
        if own.sum() >= LEAST_POINTS:
            cloud = oriented(Points(positions[own], towards[own], 0.0))
            if len(cloud.points) > MOST_POINTS:
                cloud = cloud.farthest_point_down_sample(MOST_POINTS)
        if own.sum() < LEAST_POINTS or len(cloud.points) < LEAST_POINTS:
            raise UserError(
                f"only {own.sum()} depths lie in the box of {name}, {LEAST_POINTS} are needed; correct its place and "
                "box in scene.yaml, or go nearer."
            )
        T = item.matrix(scene.support_plane)
        local = (np.asarray(cloud.points) - T[:3, 3]) @ T[:3, :3]
        found[name] = PartialCloud(local, np.asarray(cloud.normals) @ T[:3, :3], T)
    return found
