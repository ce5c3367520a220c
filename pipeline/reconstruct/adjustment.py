"""Bundle adjustment of cameras, tags and points together, in metres.

Tags are rigid squares of known size. Where their places are known they are held there as well as a person measures, and
otherwise by nothing. Points are eliminated (Schur complement), so that the linear system has the size of lenses, poses
and tags alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array, csr_array
from scipy.spatial.transform import Rotation

from pipeline.reconstruct.lens import Lens

CORNER_PIXELS, POINT_PIXELS = 0.3, 0.7  # standard deviations of a tag's corner and of a feature, pixels
OUTLIER = 2.5  # standard deviations from which on an observation loses weight
PLACED = 0.001  # m: standard deviation of a tag's corner from where tags.yaml says; also how flat paper lies
STEPS, ENOUGH = 40, 1e-6  # at most so many, until the cost falls by less than this fraction
LENS_SPREAD = np.array([np.inf, 0.3, 0.3, 0.01, 0.01])  # values of real lenses lie within about that of zero


@dataclass(frozen=True)
class Bundle:
    """Cameras, tags and points, and where the photos show them. Frames: the scene's, or any other one frame."""

    lenses: tuple[Lens, ...]
    lens_of: NDArray[np.int64]  # (photos,) which lens
    poses: NDArray[np.float64]  # (photos, 4, 4) from the frame to each camera
    tags: NDArray[np.float64]  # (tags, 4, 4) from each tag to the frame
    square: NDArray[np.float64]  # (4, 3) corners of a tag in its own frame, m
    corners: tuple[NDArray[np.int64], NDArray[np.float64]]  # (n, 3) photo, tag, corner; (n, 2) pixels
    points: NDArray[np.float64]  # (points, 3)
    features: tuple[NDArray[np.int64], NDArray[np.float64]]  # (m, 2) photo, point; (m, 2) pixels

    def corner_places(self) -> NDArray[np.float64]:
        """Return where all corners of all tags are (tags, 4, 3)."""
        return np.asarray(self.square @ np.swapaxes(self.tags[:, :3, :3], 1, 2) + self.tags[:, None, :3, 3])

    def middle(self) -> NDArray[np.float64]:
        """Return the middle (3,) of the tags, around which photos are taken; without tags, the frame's origin."""
        return np.asarray(self.tags[:, :3, 3].mean(axis=0) if len(self.tags) else np.zeros(3))

    def seen(self, photo: NDArray[np.int64], places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the pixels (n, 2) at which ``photo`` (n,) shows ``places`` (n, 3)."""
        local = (self.poses[photo, :3, :3] @ places[:, :, None])[..., 0] + self.poses[photo, :3, 3]
        pixels = np.empty((len(photo), 2))
        for number, lens in enumerate(self.lenses):
            own = self.lens_of[photo] == number
            pixels[own] = lens.project(local[own])[0]
        pixels[local[:, 2] <= 0] = np.inf
        return pixels

    def corner_errors(self) -> NDArray[np.float64]:
        """Return how far (n,) from its sighting every corner is seen, pixels."""
        which, pixels = self.corners
        places = self.corner_places()[which[:, 1], which[:, 2]]
        return np.asarray(np.linalg.norm(self.seen(which[:, 0], places) - pixels, axis=1))

    def feature_errors(self) -> NDArray[np.float64]:
        """Return how far (m,) from its sighting every point is seen, pixels."""
        which, pixels = self.features
        return np.asarray(np.linalg.norm(self.seen(which[:, 0], self.points[which[:, 1]]) - pixels, axis=1))


@dataclass(frozen=True)
class Freedom:
    """What is adjusted, and what holds the tags."""

    lenses: bool = True
    poses: NDArray[np.bool_] | None = None  # (photos,); None: all
    tags: bool = True
    points: bool = True
    placed: NDArray[np.float64] | None = None  # (tags, 4, 3) where the corners should be; None: nothing holds the tags


@dataclass(frozen=True)
class _Rows:
    """Linearised observations of one kind: residuals over their standard deviation, weighted."""

    residual: NDArray[np.float64]  # (n, 2)
    dense: tuple[tuple[NDArray[np.int64], NDArray[np.float64]], ...]  # first column (n,), -1 for none; (n, 2, width)
    point: tuple[NDArray[np.int64], NDArray[np.float64]] | None  # number (n,), (n, 2, 3)


def _cross(v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrices (n, 3, 3) of the cross products with ``v`` (n, 3)."""
    found = np.zeros((len(v), 3, 3))
    found[:, 0, 1], found[:, 0, 2], found[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return found - np.swapaxes(found, 1, 2)


class _Columns:
    """Where the parameters stand in the dense part of the system: lenses, poses, tags."""

    def __init__(self, bundle: Bundle, freedom: Freedom) -> None:
        self.lens, at = np.full(len(bundle.lenses), -1), 0
        for number, lens in enumerate(bundle.lenses):
            if freedom.lenses and lens.free:
                self.lens[number], at = at, at + 5
        free = np.ones(len(bundle.poses), bool) if freedom.poses is None else freedom.poses
        self.pose = np.where(free, at + 6 * (np.cumsum(free) - 1), -1)
        at += 6 * int(free.sum())
        self.tag = at + 6 * np.arange(len(bundle.tags)) if freedom.tags else np.full(len(bundle.tags), -1)
        self.count = at + (6 * len(bundle.tags) if freedom.tags else 0)


def _weights(residual: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the square roots (n, 1) of Cauchy's weights."""
    return np.asarray(1 / np.sqrt(1 + (residual**2).sum(axis=1, keepdims=True) / OUTLIER**2))


def _seen_rows(
    bundle: Bundle,
    columns: _Columns,
    photo: NDArray[np.int64],
    places: NDArray[np.float64],
    pixels: NDArray[np.float64],
    spread: float,
    tag: NDArray[np.int64] | None,
    point: NDArray[np.int64] | None,
) -> _Rows:
    R = bundle.poses[photo, :3, :3]
    turned = (R @ places[:, :, None])[..., 0]
    local = turned + bundle.poses[photo, :3, 3]
    seen, by_point, by_lens = np.empty((len(photo), 2)), np.empty((len(photo), 2, 3)), np.empty((len(photo), 2, 5))
    for number, lens in enumerate(bundle.lenses):
        own = bundle.lens_of[photo] == number
        seen[own], by_point[own], by_lens[own] = lens.project(local[own])
        by_lens[own, :, lens.free :] = 0
    residual = (seen - pixels) / spread
    root = _weights(residual) * (local[:, 2:] > 0)
    scale = (root / spread)[:, :, None]
    by_pose = np.concatenate([-by_point @ _cross(turned), by_point], axis=2)
    dense = [(columns.lens[bundle.lens_of[photo]], by_lens * scale), (columns.pose[photo], by_pose * scale)]
    by_place = by_point @ R
    if tag is not None:
        arm = places - bundle.tags[tag, :3, 3]
        dense.append((columns.tag[tag], np.concatenate([-by_place @ _cross(arm), by_place], axis=2) * scale))
    return _Rows(residual * root, tuple(dense), None if point is None else (point, by_place * scale))


def _jacobian(rows: _Rows, count: int) -> csr_array:
    """Return the derivatives (2 n, ``count``) by the dense parameters."""
    n = len(rows.residual)
    row, column, value = [], [], []
    for first, block in rows.dense:
        held = first >= 0
        width = block.shape[2]
        row.append(np.broadcast_to((2 * np.arange(n)[held])[:, None, None] + np.arange(2)[:, None], block[held].shape))
        column.append(np.broadcast_to(first[held][:, None, None] + np.arange(width), block[held].shape))
        value.append(block[held])
    flat = [np.concatenate([part.reshape(-1) for part in parts]) for parts in (value, row, column)]
    return csr_array((flat[0], (flat[1], flat[2])), shape=(2 * n, count))


def _placed_terms(
    bundle: Bundle, columns: _Columns, placed: NDArray[np.float64], H: NDArray[np.float64], g: NDArray[np.float64]
) -> None:
    """Add what holds the tags' corners to their places."""
    corners = bundle.corner_places()
    for number, first in enumerate(columns.tag):
        if first < 0 or not np.isfinite(placed[number]).all():
            continue
        arm = corners[number] - bundle.tags[number, :3, 3]
        J = np.concatenate([-_cross(arm), np.broadcast_to(np.eye(3), (4, 3, 3))], axis=2).reshape(12, 6) / PLACED
        residual = (corners[number] - placed[number]).reshape(12) / PLACED
        own = slice(first, first + 6)
        H[own, own] += J.T @ J
        g[own] += J.T @ residual


@dataclass(frozen=True)
class _System:
    """Normal equations: dense parameters, points, and what ties them."""

    H: NDArray[np.float64]
    g: NDArray[np.float64]
    tie: Any  # (dense, 3 points) sparse
    V: NDArray[np.float64]  # (points, 3, 3)
    b: NDArray[np.float64]  # (points, 3)

    def reduced(self, damping: float) -> tuple[NDArray[np.float64], NDArray[np.float64], Any]:
        """Return the dense system without the points, and what leads back to them."""
        H = self.H + damping * np.diag(np.diag(self.H)) + 1e-12 * np.eye(len(self.H))
        if not len(self.V):
            return H, self.g, None
        V = self.V * (1 + damping * np.eye(3)) + 1e-9 * np.eye(3)
        count = len(V)
        inverse = bsr_array((np.linalg.inv(V), np.arange(count), np.arange(count + 1)), shape=(3 * count, 3 * count))
        through = (self.tie @ inverse).tocsr()
        return H - (through @ self.tie.T).toarray(), self.g - through @ self.b.reshape(-1), inverse

    def step(self, damping: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the step of the dense parameters and of the points (points, 3)."""
        H, g, inverse = self.reduced(damping)
        dense: NDArray[np.float64] = -np.asarray(np.linalg.solve(H, g), np.float64) if len(H) else np.zeros(0)
        if inverse is None:
            return dense, np.zeros((0, 3))
        return dense, -(inverse @ (self.b.reshape(-1) + self.tie.T @ dense)).reshape(-1, 3)


def _observed(bundle: Bundle, columns: _Columns, freedom: Freedom) -> list[_Rows]:
    which, pixels = bundle.corners
    places = bundle.corner_places()[which[:, 1], which[:, 2]]
    rows = [_seen_rows(bundle, columns, which[:, 0], places, pixels, CORNER_PIXELS, which[:, 1], None)]
    which, pixels = bundle.features
    if len(which):
        point = which[:, 1] if freedom.points else None
        places = bundle.points[which[:, 1]]
        rows.append(_seen_rows(bundle, columns, which[:, 0], places, pixels, POINT_PIXELS, None, point))
    return rows


def _system(bundle: Bundle, freedom: Freedom) -> _System:
    columns = _Columns(bundle, freedom)
    count, points = columns.count, len(bundle.points) if freedom.points else 0
    H, g = np.zeros((count, count)), np.zeros(count)
    tie: Any = csr_array((count, 3 * points))
    V, b = np.zeros((points, 3, 3)), np.zeros((points, 3))
    for rows in _observed(bundle, columns, freedom):
        J = _jacobian(rows, count)
        H += (J.T @ J).toarray()
        g += J.T @ rows.residual.reshape(-1)
        if rows.point is not None:
            point, block = rows.point
            np.add.at(V, point, np.swapaxes(block, 1, 2) @ block)
            np.add.at(b, point, (np.swapaxes(block, 1, 2) @ rows.residual[:, :, None])[..., 0])
            n = len(point)
            row = np.broadcast_to((2 * np.arange(n))[:, None, None] + np.arange(2)[:, None], block.shape).reshape(-1)
            column = np.broadcast_to(3 * point[:, None, None] + np.arange(3), block.shape).reshape(-1)
            tie = tie + J.T @ csr_array((block.reshape(-1), (row, column)), shape=(2 * n, 3 * points))
    for number, first in enumerate(columns.lens):
        if first >= 0:
            lens = bundle.lenses[number]
            pull = 1 / LENS_SPREAD**2
            own = np.arange(first, first + 5)
            H[own, own] += np.where(np.arange(5) < lens.free, pull, 1.0)
            g[own] += np.where(np.arange(5) < lens.free, pull * lens.values, 0.0)
    if freedom.placed is not None:
        _placed_terms(bundle, columns, freedom.placed, H, g)
    return _System(H, g, tie, V, b)


def _cost(bundle: Bundle, placed: NDArray[np.float64] | None) -> float:
    errors = np.concatenate([bundle.corner_errors() / CORNER_PIXELS, bundle.feature_errors() / POINT_PIXELS])
    cost = float((OUTLIER**2 * np.log1p(np.minimum(errors, 1e6) ** 2 / OUTLIER**2)).sum())
    if placed is not None:
        off = (bundle.corner_places() - placed) / PLACED
        cost += float((off[np.isfinite(off)] ** 2).sum())
    return cost + float(sum(((lens.values / LENS_SPREAD) ** 2)[: lens.free].sum() for lens in bundle.lenses))


def _turned(poses: NDArray[np.float64], steps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return poses (n, 4, 4) after small turns and shifts (n, 6)."""
    found = poses.copy()
    found[:, :3, :3] = Rotation.from_rotvec(steps[:, :3]).as_matrix() @ poses[:, :3, :3]
    found[:, :3, 3] += steps[:, 3:]
    return found


def _moved(bundle: Bundle, freedom: Freedom, dense: NDArray[np.float64], points: NDArray[np.float64]) -> Bundle:
    columns = _Columns(bundle, freedom)
    lenses = tuple(
        lens if first < 0 else lens.with_values(lens.values + dense[first : first + 5])
        for lens, first in zip(bundle.lenses, columns.lens, strict=True)
    )
    poses, tags = bundle.poses.copy(), bundle.tags
    own = columns.pose >= 0
    if own.any():
        poses[own] = _turned(poses[own], dense[columns.pose[own][:, None] + np.arange(6)])
    if len(tags) and columns.tag[0] >= 0:
        tags = _turned(tags, dense[columns.tag[:, None] + np.arange(6)])
    moved = bundle.points + points if len(points) else bundle.points
    return replace(bundle, lenses=lenses, poses=poses, tags=tags, points=moved)


def adjust(bundle: Bundle, freedom: Freedom) -> Bundle:
    """Return the bundle that fits the photos best: Levenberg and Marquardt's steps, Cauchy's weights."""
    damping, cost = 1e-4, _cost(bundle, freedom.placed)
    for _ in range(STEPS):
        system, better = _system(bundle, freedom), None
        while damping < 1e6 and better is None:
            tried = _moved(bundle, freedom, *system.step(damping))
            new = _cost(tried, freedom.placed) if min(lens.focal for lens in tried.lenses) > 1 else np.inf
            if new < cost:
                better = tried
            damping = max(damping / 8, 1e-9) if better is not None else damping * 8
        if better is None:
            break
        fallen, bundle, cost = (cost - new) / cost, better, new
        if fallen < ENOUGH:
            break
    return bundle


def focal_spread(bundle: Bundle, freedom: Freedom) -> NDArray[np.float64]:
    """Return the standard deviation (lenses,) of each focal length, pixels; 0 where it is not estimated."""
    columns = _Columns(bundle, freedom)
    H, _, _ = _system(bundle, freedom).reduced(1e-12)
    spread = np.sqrt(np.abs(np.diag(np.linalg.pinv(H, hermitian=True))))
    return np.array([spread[first] if first >= 0 else 0.0 for first in columns.lens])
