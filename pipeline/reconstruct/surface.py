"""Closed surfaces from points: screened Poisson, cut off at the support, and samples of the result."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import manifold3d
import numpy as np
import open3d
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pipeline.reconstruct.fusion import Points
from pipeline.reconstruct.silhouettes import Bound
from pipeline.records.captures import Scene
from pipeline.records.errors import UserError
from pipeline.records.parameters.reconstruct import SurfaceParameters

NORMAL_NEIGHBOURS = 40
OUTLIER_NEIGHBOURS, OUTLIER_SPREAD = 20, 2.5
SUPPORT_BAND, SUPPORT_SHARE = 0.008, 0.25  # m, and share of an object's height: level points below are the support's
SUPPORT_COSINE = 0.8
# Edges of the cube in which Poisson's surface is sought, over that of the points. Where a whole side was not measured,
# as between two objects that touch, the surface bulges out of the smaller one and stays open.
CUBES = (1.3, 2.0)
LOW_BAND = 0.008  # m: so much of the lowest that was measured tells where the object meets the support
# m over the support: an object that was measured down to the first goes straight on, above the second it is round.
STRAIGHT_DOWN, ROUND_BELOW = 0.004, 0.010
SECTORS, LEAST_IN_SECTOR = 48, 5  # directions around an object, and points that one needs
SIMPLIFIED = 0.00003  # m: edges shorter than that, and what is flat to that, take fewer triangles
SEEN = 0.003  # m: farther from all measured points the surface is a guess
CANDIDATES_PER_SAMPLE = 10


@dataclass(frozen=True)
class Surface:
    """A closed surface in the scene frame."""

    vertices: NDArray[np.float64]  # (V, 3), m
    faces: NDArray[np.int64]  # (F, 3), counter-clockwise from outside


@dataclass(frozen=True)
class Samples:
    """Farthest-point samples of a surface."""

    points: NDArray[np.float64]  # (n, 3), scene frame
    normals: NDArray[np.float64]  # (n, 3), outward
    seen: NDArray[np.bool_]  # (n,) measured nearby; False: underside, or closed by a guess


def belongs_to(positions: NDArray[np.float64], scene: Scene, settings: SurfaceParameters) -> NDArray[np.int64]:
    """Return per point (n,) the number of the object in whose box it lies, -1 for none.

    A point within the margins of several boxes belongs to the nearest, so that objects may touch.
    """
    best, owner = np.full(len(positions), settings.margin), np.full(len(positions), -1, np.int64)
    for number, item in enumerate(scene.objects.values()):
        T = item.matrix(scene.support_plane)
        local = (positions - T[:3, 3]) @ T[:3, :3]
        half = np.array([item.box[0] / 2, item.box[1] / 2])
        outside = np.concatenate([np.abs(local[:, :2]) - half, local[:, 2:] - item.box[2]], axis=1)
        distance = np.where(
            (outside > 0).any(axis=1), np.linalg.norm(np.maximum(outside, 0), axis=1), outside.max(axis=1)
        )
        inside = (distance < best) & (local[:, 2] > settings.clearance)
        best[inside], owner[inside] = distance[inside], number
    return owner


def oriented(points: Points) -> Any:
    """Return an Open3D cloud without lone points, its normals turned to the cameras."""
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points.positions))
    cloud.normals = open3d.utility.Vector3dVector(points.towards)
    _, kept = cloud.remove_statistical_outlier(OUTLIER_NEIGHBOURS, OUTLIER_SPREAD)
    cloud = cloud.select_by_index(kept)
    towards = points.towards[np.asarray(kept, np.int64)]
    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(NORMAL_NEIGHBOURS), fast_normal_computation=False)
    normals = np.asarray(cloud.normals)
    cloud.normals = open3d.utility.Vector3dVector(
        normals * np.where((normals * towards).sum(axis=1) < 0, -1, 1)[:, None]
    )
    return cloud


@dataclass(frozen=True)
class _Foot:
    """How an object meets its support, per direction (n,) from its middle in which something was measured; in m."""

    middle: NDArray[np.float64]  # (2,)
    angles: NDArray[np.float64]
    gaps: NDArray[np.float64]  # height of the lowest that was measured
    starts: NDArray[np.float64]  # distance from the middle there
    tangents: NDArray[np.float64]  # the same where the tangent of the surface there meets the support
    ends: NDArray[np.float64]  # the same where the surface is taken to meet it

    @staticmethod
    def of(positions: NDArray[np.float64], normals: NDArray[np.float64], height: NDArray[np.float64]) -> _Foot | None:
        """Return the foot of points (n, 3) with their heights (n,) over the support; None when nothing tells."""
        lower = height < np.percentile(height, 50)
        p, n, h = positions[lower], normals[lower], height[lower]
        middle = (p[:, :2].min(axis=0) + p[:, :2].max(axis=0)) / 2
        angle = np.arctan2(p[:, 1] - middle[1], p[:, 0] - middle[0])
        sector = np.floor((angle + np.pi) / (2 * np.pi) * SECTORS).astype(np.int64) % SECTORS
        known = []
        for k in range(SECTORS):
            own = np.flatnonzero(sector == k)
            if len(own) < LEAST_IN_SECTOR:
                continue
            gap = float(np.percentile(h[own], 3))
            own = own[h[own] < gap + LOW_BAND]
            level = np.maximum(np.linalg.norm(n[own, :2], axis=1), 1e-3)
            # Along the steepest tangent, hardly outwards whatever a noisy normal says.
            slope = np.clip(n[own, 2] / level, -1, 0.3)
            start = float(np.median(np.linalg.norm(p[own, :2] - middle, axis=1) + slope * (h[own] - gap)))
            tangent = max(start + float(np.median(slope)) * gap, 0.0)
            roundness = np.clip((gap - STRAIGHT_DOWN) / (ROUND_BELOW - STRAIGHT_DOWN), 0, 1)
            end = max(tangent - roundness * float(np.hypot(gap, start - tangent)), 0.0)
            known.append(((k + 0.5) / SECTORS * 2 * np.pi - np.pi, gap, start, tangent, end))
        return _Foot(middle, *np.array(known).T) if known else None

    def around(self, values: NDArray[np.float64], angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return ``values``, known in the directions that were measured, at ``angles`` (m,)."""
        return np.asarray(np.interp(angles, self.angles, values, period=2 * np.pi))

    def wall(self, spacing: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return points (n, 3), heights over the support, and normals from what was measured down to the support."""
        angles = np.arange(-np.pi, np.pi, spacing / max(float(self.starts.max()), spacing))
        steps = max(int(np.ceil(1.5 * float((self.gaps + self.starts - self.ends).max()) / spacing)), 2)
        t = np.linspace(0, 1, steps, endpoint=False)[:, None]  # 0: where measured points end, 1: on the support
        columns = (self.gaps, self.starts, self.tangents, self.ends)
        gap, start, tangent, end = (self.around(values, angles) for values in columns)
        radius = (1 - t) ** 2 * start + 2 * t * (1 - t) * tangent + t**2 * end
        x, y = self.middle[0] + radius * np.cos(angles), self.middle[1] + radius * np.sin(angles)
        points = np.stack([x, y, gap * (1 - t) ** 2], axis=-1)
        out = gap * (1 - t)
        down = (1 - t) * (start - tangent) + t * (tangent - end)
        normals = np.stack([out * np.cos(angles), out * np.sin(angles), -down], axis=-1)
        normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
        return points.reshape(-1, 3), normals.reshape(-1, 3)

    def base(self, spacing: float) -> NDArray[np.float64]:
        """Return positions (n, 2) all over the base."""
        largest = float(self.ends.max())
        axis = np.arange(-largest, largest + spacing, spacing)
        grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
        reach = self.around(self.ends, np.arctan2(grid[:, 1], grid[:, 0]))
        return np.asarray(grid[np.linalg.norm(grid, axis=1) <= reach] + self.middle)


def assumed_base(
    positions: NDArray[np.float64], normals: NDArray[np.float64], support: float, spacing: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return points (n, 3) and normals (n, 3) of the part that no photo shows: down to the support, and the base.

    Poisson's surface stays open where nothing was measured, so something must be assumed. In each direction from the
    middle, the surface goes on from the lowest measured points along its tangent. Where they reach nearly to the
    support it goes straight down; where they end high above it, the underside is taken to be round: an arc (a parabola
    with the two tangents of the circle) from that tangent into the support. Below lies a flat base.
    """
    foot = _Foot.of(positions, normals, positions[:, 2] - support)
    if foot is None:
        return np.zeros((0, 3)), np.zeros((0, 3))
    wall, wall_normals = foot.wall(spacing)
    wall[:, 2] += support
    inside = foot.base(spacing)
    # The base lies a little below the support, where the surface is cut off, so that the cut is flat.
    base = np.column_stack([inside, np.full(len(inside), support - 2 * spacing)])
    base_normals = np.broadcast_to(np.array([0.0, 0.0, -1.0]), base.shape)
    return np.concatenate([wall, base]), np.concatenate([wall_normals, base_normals])


def _solid(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> Any:
    return manifold3d.Manifold(
        manifold3d.Mesh64(np.ascontiguousarray(vertices), np.ascontiguousarray(faces, np.uint64))
    )


def closed_at_support(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], support: float, bound: NDArray[np.float64]
) -> Surface | None:
    """Return the largest closed part of a surface above the plane z = support, closed by that plane.

    None: there is none.

    Args:
        bound: points (n, 3) beyond whose convex hull the surface may not reach.
    """
    hull = manifold3d.Manifold.hull_points(np.ascontiguousarray(bound))
    solid = (_solid(vertices, faces) ^ hull).trim_by_plane((0.0, 0.0, 1.0), support)
    parts = [part for part in solid.decompose() if part.volume() > 0]
    if not parts:
        return None
    mesh = max(parts, key=lambda part: part.volume()).simplify(SIMPLIFIED).to_mesh64()
    return Surface(np.asarray(mesh.vert_properties, np.float64)[:, :3], np.asarray(mesh.tri_verts, np.int64))


def poisson_surface(
    points: Points,
    support: float,
    spacing: float,
    settings: SurfaceParameters,
    name: str,
    bound: Bound | None = None,
) -> Surface:
    """Return the closed surface through the points of one object.

    Args:
        support: z of the plane on which it stands, m.
        spacing: of the points, m.
        bound: how far it may reach, if photos tell.

    Raises:
        UserError: there are too few points, or they enclose nothing.
    """
    if len(points.positions) < settings.least_points:
        raise UserError(
            f"{name}: only {len(points.positions)} surface points were measured in its box; correct its position and "
            "box in scene.yaml, or give it some texture (stickers, powder) and take sharper photos."
        )
    cloud = oriented(points)
    positions, normals = np.asarray(cloud.points), np.asarray(cloud.normals)
    height = positions[:, 2] - support
    band = min(SUPPORT_BAND, SUPPORT_SHARE * float(np.percentile(height, 99)))
    own = (height > band) | (normals[:, 2] < SUPPORT_COSINE)
    positions, normals = positions[own], normals[own]
    assumed, directions = assumed_base(positions, normals, support, spacing)
    positions, normals = np.concatenate([positions, assumed]), np.concatenate([normals, directions])
    cloud.points, cloud.normals = open3d.utility.Vector3dVector(positions), open3d.utility.Vector3dVector(normals)
    for cube in CUBES:
        mesh, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
            cloud, depth=settings.poisson_depth, scale=cube, n_threads=1
        )
        mesh.remove_duplicated_vertices()
        mesh.remove_degenerate_triangles()
        mesh.remove_unreferenced_vertices()
        vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.triangles, np.int64)
        if bound is not None:
            vertices = bound.drawn_in(vertices)
        closed = closed_at_support(vertices, faces, support, positions + spacing * normals)
        if closed is not None:
            return closed
    raise UserError(
        f"{name}: its points enclose no volume; take more photos of it, from all sides, or give it some texture."
    )


def samples_of(surface: Surface, measured: NDArray[np.float64], count: int, seed: int) -> Samples:
    """Return farthest-point samples of a surface; ``measured`` (n, 3) are the points it was made from."""
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    candidates, face = trimesh.sample.sample_surface(mesh, count * CANDIDATES_PER_SAMPLE, seed=seed)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(np.asarray(candidates)))
    cloud.normals = open3d.utility.Vector3dVector(mesh.face_normals[face])
    spread = cloud.farthest_point_down_sample(count)
    points, normals = np.asarray(spread.points), np.asarray(spread.normals)
    return Samples(points, normals, cKDTree(measured).query(points)[0] < SEEN)
