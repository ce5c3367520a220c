"""Boxes and balls fitted to convex solids, one after the other where the worst is, until all are near enough.

Boxes stand along the axes of the link, as the energy kernel wants them. A region begins as a whole solid and is halved
along the axis that serves best; each region gets the best box, out of a grid of shrunken sizes, or ball. Solids of a
link that lose little by it become one region. The error of a fit is the largest distance of points on the solids'
surface from that of boxes and balls, and of points on boxes and balls beyond the solids.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

SAMPLES = 200  # points on the surface of a solid while fitting
SHRINKS = np.array(list(product((0.0, 0.06, 0.12, 0.18), repeat=3)))  # of boxes, as shares of the region's extents
CORNERS = np.array([p for p in product((-1.0, 0.0, 1.0), repeat=3) if any(p)])  # of a box, and of its edges and faces
AROUND = np.array(trimesh.creation.icosphere(subdivisions=1).vertices)  # directions of points on a ball
SUPPORTS = np.array(trimesh.creation.icosphere(subdivisions=2).vertices)  # where corners of fine meshes are looked for
FARTHEST = 60  # points of a fit whose distance from the solids is computed exactly
NEAR = 1e-4  # m, that count as touching
HELPS = 0.9  # share of a region's error that its halves have at most, if they are to replace it
MOST_OF_LINK = 16  # regions of a link, unless it has more shapes
SMALLEST = 0.004  # m; regions that are smaller are not halved


@dataclass(frozen=True)
class Part:
    """A box (``radius`` 0) or a ball (``half`` 0), link frame."""

    centre: NDArray[np.float64]  # (3,)
    half: NDArray[np.float64]  # (3,)
    radius: float

    def distances(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return signed distances (n,) of points (n, 3), m."""
        beyond = np.abs(points - self.centre) - self.half
        return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(1), 0.0) - self.radius

    def surface(self) -> NDArray[np.float64]:
        """Return points (n, 3) on the surface."""
        if self.radius > 0:
            return self.centre + self.radius * SUPPORTS
        box = trimesh.creation.box(2 * self.half)
        points = np.concatenate([trimesh.sample.sample_surface(box, 150, seed=2)[0], CORNERS * self.half])
        return points + self.centre

    def outward(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return outward unit normals (n, 3) at points (n, 3) on the surface, of one face at edges."""
        away = points - self.centre
        if self.radius > 0:
            return away / np.linalg.norm(away, axis=1, keepdims=True)
        normals = np.zeros_like(away)
        rows, axes = np.arange(len(away)), (np.abs(away) - self.half).argmax(1)
        normals[rows, axes] = np.sign(away[rows, axes])
        return normals


class Solid:
    """A convex solid in its link's frame, with points on its surface."""

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        vertices = np.asarray(mesh.vertices)
        if len(vertices) > len(SUPPORTS):
            vertices = vertices[np.unique((vertices @ SUPPORTS.T).argmax(0))]
        self.hull = trimesh.Trimesh(vertices).convex_hull
        planes = np.column_stack(
            [self.hull.face_normals, np.einsum("ni,ni->n", self.hull.face_normals, self.hull.triangles[:, 0])]
        )
        self.planes = planes[np.unique(np.round(planes, 6), axis=0, return_index=True)[1]]
        self.low, self.high = vertices.min(0), vertices.max(0)

    def sampled(self, count: int, seed: int) -> NDArray[np.float64]:
        """Return points (n, 3) on the surface, corners among them."""
        return np.concatenate([self.on_faces(count, seed)[0], self.hull.vertices])

    def on_faces(self, count: int, seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return points (n, 3) on the faces and the outward unit normals (n, 3) there."""
        points, faces = trimesh.sample.sample_surface(self.hull, count, seed=seed)
        return np.asarray(points), np.asarray(self.hull.face_normals[faces])

    def depths(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return signed distances (n,) of points (n, 3): exact inside, a lower bound outside."""
        found = np.maximum(self.low - points, points - self.high).max(1)
        near = found < NEAR
        found[near] = (points[near] @ self.planes[:, :3].T - self.planes[:, 3]).max(1)
        return found

    def exact(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return exact distances (n,) of points (n, 3) that are outside."""
        triangles = np.asarray(self.hull.triangles)
        pairs = np.repeat(points, len(triangles), axis=0)
        near = trimesh.triangles.closest_point(np.tile(triangles, (len(points), 1, 1)), pairs)
        found: NDArray[np.float64] = np.linalg.norm(near - pairs, axis=1).reshape(len(points), -1).min(1)
        return found


class Region:
    """Solids of a link, or what of one lies between bounds, represented by one box or ball."""

    def __init__(
        self,
        solids: Sequence[Solid],
        of_link: Sequence[Solid],
        corners: Sequence[NDArray[np.float64]],
        samples: NDArray[np.float64],
        known: Part | None = None,
    ) -> None:
        """Take what of ``solids`` has ``corners`` (n, 3) each, with its visible ``samples`` (n, 3)."""
        self.solids, self.of_link, self.corners, self.samples, self.known = solids, of_link, corners, samples, known
        self.is_whole = False
        self.parent: Region | None = None
        self.children: tuple[Region, Region] | None = None

    @classmethod
    def whole(cls, solids: Sequence[Solid], of_link: Sequence[Solid], known: Part | None = None) -> Region:
        """Return the region of some solids of a link; ``known`` is what the only one is, if it is a box or ball."""
        seen = []
        for one in solids:
            points = one.sampled(SAMPLES, 0)
            hidden = np.zeros(len(points), dtype=bool)
            for other in of_link:
                if other is not one:
                    hidden |= other.depths(points) < -NEAR
            seen.append(points[~hidden])
        region = cls(solids, of_link, [np.asarray(one.hull.vertices) for one in solids], np.concatenate(seen), known)
        region.is_whole = True
        return region

    @property
    def part(self) -> Part:
        """The best box or ball."""
        return self._best[0]

    @property
    def error(self) -> float:
        """Its error, m, as far as this region is concerned."""
        return self._best[1]

    @cached_property
    def _bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        corners = np.concatenate(self.corners)
        return corners.min(0), corners.max(0)

    @cached_property
    def _best(self) -> tuple[Part, float]:
        if self.known is not None:
            return self.known, 0.0
        low, high = self._bounds
        middle, half = (low + high) / 2, np.maximum((high - low) / 2, 1e-5)
        found = [self._best_box(middle, half)]
        balls = [self._ball(middle)]
        if len(self.samples) >= 8:
            columns = np.column_stack([2 * self.samples, np.ones(len(self.samples))])
            centre = np.linalg.lstsq(columns, (self.samples**2).sum(1), rcond=None)[0][:3]
            balls.append(self._ball(centre))
        found += [(ball, self._error(ball)) for ball in balls if 0 < ball.radius < 2 * half.max()]
        return min(found, key=lambda one: one[1])

    def _ball(self, centre: NDArray[np.float64]) -> Part:
        away = np.linalg.norm(self.samples - centre, axis=1) if len(self.samples) else np.zeros(1)
        return Part(centre, np.zeros(3), float(away.min() + away.max()) / 2)

    def _error(self, part: Part) -> float:
        points = part.centre + (part.half * CORNERS if part.radius == 0 else part.radius * AROUND)
        gap = np.abs(part.distances(self.samples)).max(initial=0.0)
        return float(max(gap, self._beyond(points).max()))

    def _beyond(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far points (n, 3) are outside all solids of the link; 0 inside."""
        return np.maximum(np.min([one.depths(points) for one in self.of_link], axis=0), 0.0)

    def _best_box(self, middle: NDArray[np.float64], half: NDArray[np.float64]) -> tuple[Part, float]:
        halves = half * (1 - SHRINKS)
        apart = np.abs(self.samples - middle)[None] - halves[:, None]
        gaps = np.linalg.norm(np.maximum(apart, 0.0), axis=2) + np.minimum(apart.max(2, initial=-np.inf), 0.0)
        points = middle + halves[:, None] * CORNERS
        beyond = self._beyond(points.reshape(-1, 3)).reshape(len(halves), -1)
        errors = np.maximum(np.abs(gaps).max(1, initial=0.0), beyond.max(1))
        best = int(errors.argmin())
        return Part(middle, halves[best], 0.0), float(errors[best])

    def useful(self) -> list[Region]:
        """Return the smallest regions of what was halved, or this one where that did not help."""
        if self.children is None:
            return [self]
        found = [region for child in self.children for region in child.useful()]
        return found if max(region.error for region in found) < HELPS * self.error else [self]

    def halves(self) -> tuple[Region, Region] | None:
        """Return the two halves along the axis that serves best, None where it is too small."""
        if self.known is not None:
            return None
        found: list[tuple[float, Region, Region]] = []
        low, high = self._bounds
        for axis in range(3):
            if high[axis] - low[axis] < 2 * SMALLEST:
                continue
            middle = (low[axis] + high[axis]) / 2
            cut = [_cut(corners, axis, middle) for corners in self.corners]
            lower = self.samples[:, axis] <= middle
            pair = [
                Region(self.solids, self.of_link, [own[side] for own in cut if len(own[side])], self.samples[chosen])
                for side, chosen in ((0, lower), (1, ~lower))
            ]
            errors = [one.error for one in pair]
            found.append((max(errors) + 0.1 * sum(errors), pair[0], pair[1]))
        if not found:
            return None
        _, one, other = min(found, key=lambda entry: entry[0])
        return one, other


def _cut(corners: NDArray[np.float64], axis: int, at: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the corners of what of a convex hull lies below and above a plane across an axis, (0, 3) where nothing."""
    below = corners[:, axis] <= at
    if below.all() or not below.any():
        return corners[below], corners[~below]
    try:
        simplices = ConvexHull(corners).simplices
        edges = np.sort(np.concatenate([simplices[:, [0, 1]], simplices[:, [1, 2]], simplices[:, [0, 2]]]))
    except QhullError:  # flat
        edges = np.array(list(combinations(range(len(corners)), 2)))
    start, end = corners[edges[:, 0]], corners[edges[:, 1]]
    crossing = (start[:, axis] - at) * (end[:, axis] - at) < 0
    start, end = start[crossing], end[crossing]
    share = ((at - start[:, axis]) / (end[:, axis] - start[:, axis]))[:, None]
    on_plane = np.unique(start + share * (end - start), axis=0)
    return np.concatenate([corners[below], on_plane]), np.concatenate([corners[~below], on_plane])


def fit(links: Sequence[list[Region]], budget: int, tolerance: float) -> None:
    """Change the regions of links until none is worse than the tolerance, or the budget of regions does not suffice.

    The worst is halved; for that, where the budget is used up, solids become one that lose less than half as much.
    """
    merges: dict[tuple[int, int], Region] = {}
    while sum(map(len, links)) > budget:
        cheapest = _cheapest_merge(links, merges)
        assert cheapest is not None, "one part per link is within the budget"
        _merge(*cheapest)
    _halve_worst(links, budget, tolerance, merges)
    for own in links:
        own[:] = [region for root in {id(_root(one)): _root(one) for one in own}.values() for region in root.useful()]


def _root(region: Region) -> Region:
    while region.parent is not None:
        region = region.parent
    return region


def _halve_worst(
    links: Sequence[list[Region]], budget: int, tolerance: float, merges: dict[tuple[int, int], Region]
) -> None:
    stuck: set[int] = set()
    while True:
        waiting = [
            (one.error, index, one)
            for index, own in enumerate(links)
            for one in own
            if id(one) not in stuck and len(own) < MOST_OF_LINK
        ]
        error, index, worst = max(waiting, key=lambda entry: entry[0], default=(0.0, 0, None))
        if worst is None or error <= tolerance:
            return
        pair = worst.halves()
        if pair is None:
            stuck.add(id(worst))
            continue
        if sum(map(len, links)) == budget:
            cheapest = _cheapest_merge(links, merges)
            if cheapest is None or cheapest[-1].error > error / 2 or worst in cheapest:
                return
            _merge(*cheapest)
        place = links[index].index(worst)
        links[index][place : place + 1] = pair
        worst.children, pair[0].parent, pair[1].parent = pair, worst, worst


def _cheapest_merge(
    links: Sequence[list[Region]], merges: dict[tuple[int, int], Region]
) -> tuple[list[Region], Region, Region, Region] | None:
    """Return the regions of a link, the two of them that lose least as one, and that one."""
    best: tuple[list[Region], Region, Region, Region] | None = None
    for regions in links:
        whole = [region for region in regions if region.is_whole]
        for one, other in combinations(whole, 2):
            key = (id(one), id(other))
            if key not in merges:
                merges[key] = Region.whole([*one.solids, *other.solids], one.of_link)
            if best is None or merges[key].error < best[-1].error:
                best = (regions, one, other, merges[key])
    return best


def _merge(regions: list[Region], one: Region, other: Region, joined: Region) -> None:
    regions[regions.index(one)] = joined
    regions.remove(other)


def exact_error(parts: Sequence[Part], solids: Sequence[Solid]) -> float:
    """Return the error of a link's fit, m, from many points and with exact distances."""
    largest = 0.0
    for one in solids:
        points, normals = one.on_faces(600, 1)
        points, normals = (
            np.concatenate([points, one.hull.vertices]),
            np.pad(normals, ((0, len(one.hull.vertices)), (0, 0))),
        )
        for other in solids:
            if other is not one:  # where two solids touch they have no surface together
                kept = other.depths(points + 2 * NEAR * normals) >= -NEAR
                points, normals = points[kept], normals[kept]
        if len(points):
            largest = max(largest, float(np.abs(np.min([part.distances(points) for part in parts], axis=0)).max()))
    outside = [np.zeros((0, 3))]
    for part in parts:
        points = part.surface()
        for rest in parts:
            if rest is not part:  # where two parts touch the fit has no surface
                points = points[rest.distances(points + 2 * NEAR * part.outward(points)) >= -NEAR]
        outside.append(points)
    points = np.concatenate(outside)
    at_least = np.min([one.depths(points) for one in solids], axis=0)
    largest = max(largest, float(-at_least.min(initial=0.0)))  # what of the fit's surface lies inside
    farthest = points[np.argsort(-at_least, kind="stable")[:FARTHEST]]
    farthest = farthest[np.min([one.depths(farthest) for one in solids], axis=0) > NEAR]
    if len(farthest):
        largest = max(largest, float(np.min([one.exact(farthest) for one in solids], axis=0).max()))
    return largest
