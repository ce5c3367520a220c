"""Boxes and balls fitted to convex solids: how far the two surfaces are from each other, both ways, at most.

Boxes stand along the axes of the link, as the energy kernel wants them. A few families are tried: one box or ball, slabs
along an axis, balls in a row, a box with balls at its ends; each with a grid of sizes around the solid's own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
import trimesh
from numpy.typing import NDArray

MOST_PARTS = 5  # of a fit to one solid
SAMPLES = 160  # points on the surface of a solid while fitting
EXACT_SAMPLES = 1500  # and when the error of a fit is measured
SHRINKS = np.array([0.0, 0.06, 0.12, 0.18])  # of a box, as a share of the solid's extent
BALL_RATIOS = np.array([0.85, 0.92, 1.0, 1.08])
CORNERS = np.array([p for p in product((-1.0, 0.0, 1.0), repeat=3) if any(p)])  # of a box, and of its edges and faces
AROUND = np.array(trimesh.creation.icosphere(subdivisions=1).vertices)  # directions of points on a ball
SUPPORTS = np.array(trimesh.creation.icosphere(subdivisions=3).vertices)


@dataclass(frozen=True)
class Parts:
    """Boxes and balls as one list, ``half`` 0 for balls and ``radius`` 0 for boxes, link frame."""

    centre: NDArray[np.float64]  # (..., n, 3)
    half: NDArray[np.float64]  # (..., n, 3)
    radius: NDArray[np.float64]  # (..., n)

    def __len__(self) -> int:
        return self.centre.shape[-2]

    def pick(self, index: int) -> Parts:
        """Return one of a batch."""
        return Parts(self.centre[index], self.half[index], self.radius[index])

    def distances(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return signed distances (..., n, m) of points (..., m, 3) to every part."""
        beyond = np.abs(points[..., None, :, :] - self.centre[..., :, None, :]) - self.half[..., :, None, :]
        outside = np.sqrt((np.maximum(beyond, 0.0) ** 2).sum(-1))
        return outside + np.minimum(beyond.max(-1), 0.0) - self.radius[..., None]

    def surface(self) -> NDArray[np.float64]:
        """Return points (..., n, 42, 3) on every part."""
        on_box = np.concatenate([CORNERS, CORNERS[: len(AROUND) - len(CORNERS)]])
        return self.centre[..., None, :] + self.half[..., None, :] * on_box + self.radius[..., None, None] * AROUND


class Solid:
    """A convex solid in its link's frame, with its surface sampled."""

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        self.mesh = mesh
        vertices = np.asarray(mesh.vertices)
        if len(vertices) > len(SUPPORTS):
            vertices = vertices[np.unique((vertices @ SUPPORTS.T).argmax(0))]
        self.hull = trimesh.Trimesh(vertices).convex_hull
        normals = self.hull.face_normals
        planes = np.column_stack([normals, np.einsum("ni,ni->n", normals, self.hull.triangles[:, 0])])
        self.planes = planes[np.unique(np.round(planes, 7), axis=0, return_index=True)[1]]
        sampled = trimesh.sample.sample_surface(self.hull, SAMPLES, seed=0)[0]
        corners = np.asarray(self.hull.vertices)
        self.samples = np.concatenate([sampled, corners[:: max(1, len(corners) // 64)]])

    def depths(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return signed distances (...) of points (..., 3): exact inside, a lower bound outside."""
        flat = points.reshape(-1, 3)
        found = (flat @ self.planes[:, :3].T - self.planes[:, 3]).max(1)
        return found.reshape(points.shape[:-1])

    def exact(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return exact signed distances (n,) of points (n, 3)."""
        triangles = np.asarray(self.hull.triangles)
        closest = np.full(len(points), np.inf)
        for first in range(0, len(triangles), 64):
            chunk = triangles[first : first + 64]
            near = trimesh.triangles.closest_point(
                np.tile(chunk, (len(points), 1, 1)), np.repeat(points, len(chunk), axis=0)
            )
            away = np.linalg.norm(near - np.repeat(points, len(chunk), axis=0), axis=1).reshape(len(points), -1)
            closest = np.minimum(closest, away.min(1))
        return np.where(self.depths(points) > 0, closest, -closest)


@dataclass(frozen=True)
class Fit:
    """Parts in place of one or several solids."""

    parts: Parts
    error: float  # m


class Cluster:
    """Solids of one link that are fitted together, among the others of that link."""

    def __init__(self, solids: Sequence[Solid], others: Sequence[Solid] = ()) -> None:
        self.solids, self.others = tuple(solids), tuple(others)
        samples = []
        for one in solids:
            hidden = np.zeros(len(one.samples), dtype=bool)
            for other in (*solids, *others):
                if other is not one:
                    hidden |= other.depths(one.samples) < -1e-4
            samples.append(one.samples[~hidden])
        self.samples = np.concatenate(samples)

    def errors(self, parts: Parts) -> NDArray[np.float64]:
        """Return the errors (b,), m, of a batch of parts: largest distance between the surfaces, both ways."""
        to_parts = np.abs(parts.distances(self.samples[None]).min(-2)).max(-1)
        surface = parts.surface()
        flat = surface.reshape(len(surface), -1, 3)
        own = np.repeat(np.arange(len(parts)), surface.shape[-2])
        inside = parts.distances(flat)
        inside[:, own, np.arange(len(own))] = 0.0
        seen = inside.min(-2) > -1e-4
        for other in self.others:
            seen &= other.depths(flat) > -1e-4
        to_solids = np.min([one.depths(flat) for one in self.solids], axis=0)
        return np.maximum(to_parts, np.where(seen, np.abs(to_solids), 0.0).max(-1))

    @cached_property
    def _bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return self.samples.min(0), self.samples.max(0)

    @cached_property
    def single(self) -> Fit:
        """The best box or ball."""
        if not len(self.samples):  # hidden in the others
            return Fit(Parts(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)), 0.0)
        return self._best([self._slabs(0, 1), self._balls(1)])

    def better(self, count: int) -> Fit:
        """Return the best fit of ``count`` parts, at least two."""
        families = [self._slabs(axis, count) for axis in range(3)]
        families += [self._balls(count), *(self._ended_box(axis, count) for axis in range(3))]
        return self._best([family for family in families if family is not None])

    def _best(self, families: Sequence[Parts]) -> Fit:
        found = []
        for family in families:
            errors = self.errors(family)
            best = int(errors.argmin())
            found.append(Fit(family.pick(best), float(errors[best])))
        return min(found, key=lambda fit: fit.error)

    def _slabs(self, axis: int, count: int) -> Parts:
        """Boxes one behind the other along an axis, in a batch of shrunken sizes."""
        low, high = self._bounds
        ends = np.linspace(low[axis], high[axis], count + 1)
        centre, half = np.zeros((count, 3)), np.zeros((count, 3))
        for slab in range(count):
            margin = 0.1 * (ends[slab + 1] - ends[slab])
            within = (self.samples[:, axis] >= ends[slab] - margin) & (self.samples[:, axis] <= ends[slab + 1] + margin)
            own = self.samples[within] if within.any() else self.samples
            centre[slab], half[slab] = (own.min(0) + own.max(0)) / 2, np.ptp(own, axis=0) / 2
            centre[slab, axis], half[slab, axis] = (ends[slab] + ends[slab + 1]) / 2, (ends[slab + 1] - ends[slab]) / 2
        shrinks = np.array(list(product(SHRINKS, repeat=3)))
        halves = np.tile(half, (len(shrinks), 1, 1))
        across = [other for other in range(3) if other != axis]
        halves[:, :, across] *= 1 - shrinks[:, None, across]
        centres = np.tile(centre, (len(shrinks), 1, 1))
        cut = shrinks[:, axis] * (high[axis] - low[axis]) / 2  # at the two ends only
        for slab, sign in ((0, 1.0), (count - 1, -1.0)):
            halves[:, slab, axis] = np.maximum(halves[:, slab, axis] - cut / 2, 1e-5)
            centres[:, slab, axis] += sign * cut / 2
        return Parts(centres, halves, np.zeros(halves.shape[:2]))

    def _balls(self, count: int) -> Parts:
        """Balls in a row along the longest direction, each as thick as the solid there."""
        middle = (self.samples.min(0) + self.samples.max(0)) / 2
        direction = np.linalg.svd(self.samples - self.samples.mean(0), full_matrices=False)[2][0]
        along = (self.samples - middle) @ direction
        away = np.linalg.norm(self.samples - middle - along[:, None] * direction, axis=1)
        if count == 1:
            distance = np.linalg.norm(self.samples - middle, axis=1)
            radius = (distance.min() + distance.max()) / 2
            return Parts(middle[None, None], np.zeros((1, 1, 3)), np.array([[radius]]))
        side = np.abs(along - along.mean()) < np.ptp(along) / 4
        radius = min(float(np.median(away[side])) if side.any() else float(away.max()), np.ptp(along) / 2)
        places = np.linspace(along.min() + radius, along.max() - radius, count)
        centres = middle + places[:, None] * direction
        radii = np.empty(count)
        for ball, place in enumerate(places):
            near = np.abs(along - place) < radius / 2
            radii[ball] = np.median(away[near]) if near.any() else radius
        batch = radii * BALL_RATIOS[:, None]
        return Parts(np.tile(centres, (len(batch), 1, 1)), np.zeros((*batch.shape, 3)), batch)

    def _ended_box(self, axis: int, count: int) -> Parts | None:
        """Slabs along an axis with a ball at either end, or at one."""
        if count > 3:
            return None
        low, high = self._bounds
        middle, half = (low + high) / 2, (high - low) / 2
        across = [other for other in range(3) if other != axis]
        radius = float(half[across].min())
        if 2 * radius >= high[axis] - low[axis]:
            return None
        batch = []
        for signs in ((1.0, -1.0),) if count == 3 else ((1.0,), (-1.0,)):
            for ratio, shrink in product(BALL_RATIOS, (*SHRINKS, 0.25)):
                centres, halves = [middle.copy()], [half.copy()]
                for sign in signs:
                    end = middle.copy()
                    end[axis] += sign * (half[axis] - radius * ratio)
                    centres.append(end)
                    halves.append(np.zeros(3))
                    centres[0][axis] -= sign * radius / 2
                    halves[0][axis] -= radius / 2
                halves[0][across] *= 1 - shrink
                halves[0][axis] = max(halves[0][axis], 1e-5)
                batch.append((np.array(centres), np.array(halves), np.array([0.0, *[radius * ratio] * len(signs)])))
        centre, halved, radii = (np.array([one[field] for one in batch]) for field in range(3))
        return Parts(centre, halved, radii)


def fits(cluster: Cluster, tolerance: float) -> Iterator[Fit]:
    """Yield fits with more and more parts, each better than the one before, up to one within the tolerance."""
    best = cluster.single
    yield best
    for count in range(2, MOST_PARTS + 1):
        if best.error <= tolerance:
            return
        found = cluster.better(count)
        if found.error < best.error:
            best = found
            yield best


def exact_error(parts: Parts, solids: Sequence[Solid]) -> float:
    """Return the largest distance between the surfaces of parts and of solids, both ways, m, from many points."""
    area = np.array([one.hull.area for one in solids])
    on_solids = []
    for index, one in enumerate(solids):
        count = max(100, round(EXACT_SAMPLES * area[index] / area.sum()))
        points = np.concatenate([trimesh.sample.sample_surface(one.hull, count, seed=1)[0], one.hull.vertices])
        for other in solids:
            if other is not one:
                points = points[other.depths(points) > -1e-5]
        on_solids.append(points)
    on_parts = []
    for index in range(len(parts)):
        if parts.radius[index] > 0:
            points = parts.centre[index] + parts.radius[index] * SUPPORTS
        else:
            box = trimesh.creation.box(2 * parts.half[index])
            points = np.concatenate([trimesh.sample.sample_surface(box, 200, seed=2)[0], box.vertices])
            points = points + parts.centre[index]
        rest = [other for other in range(len(parts)) if other != index]
        if rest:
            points = points[parts.distances(points)[rest].min(0) > -1e-5]
        on_parts.append(points)
    beyond = np.concatenate(on_solids)
    one_way = np.abs(parts.distances(beyond).min(0)).max(initial=0.0)
    back = np.concatenate(on_parts)
    other_way = np.abs(np.min([one.exact(back) for one in solids], axis=0)).max(initial=0.0)
    return float(max(one_way, other_way))
