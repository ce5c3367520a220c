"""What the encoder needs of a point cloud besides its coordinates: who is whose neighbour.

Neighbourhoods depend on the points alone, so that they are found once per cloud and not in every step. Points are put
in farthest-point order; a prefix of that order is a farthest-point sample itself, so that the centres of every level
are simply the first points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.surface import farthest_points
from pipeline.records.parameters.train import EncoderParameters


@dataclass(frozen=True)
class Clouds:
    """``C`` clouds with the neighbourhoods of three levels, object frame, m."""

    points: NDArray[np.float32]  # (C, n, 3); the first centres[level] points are the centres of that level
    neighbours: tuple[NDArray[np.int64], ...]  # per level (C, centres, k) indices into the centres of the level before

    def __len__(self) -> int:
        return len(self.points)


def neighbourhoods(points: NDArray[np.float64], centres: int, radius: float, count: int) -> NDArray[np.int64]:
    """Return (centres, count) indices of the nearest points (n, 3) within ``radius`` of the first ``centres`` ones.

    Where there are fewer, the centre itself (a neighbour of itself) fills up: it does not change a maximum.
    """
    squared = ((points[:centres, None] - points[None]) ** 2).sum(-1)
    nearest = np.argsort(squared, axis=1, kind="stable")[:, : min(count, len(points))]
    near = np.take_along_axis(squared, nearest, axis=1) <= radius**2
    found = np.where(near, nearest, np.arange(centres)[:, None])
    return np.pad(found, ((0, 0), (0, count - found.shape[1])), mode="edge")


def prepare_cloud(
    points: NDArray[np.float64], settings: EncoderParameters, rng: np.random.Generator, even: bool = False
) -> Clouds:
    """Return one draw of ``settings.points`` of the surface points (m, 3) with its neighbourhoods.

    A cloud with too few points is filled up with repetitions.

    Args:
        even: take farthest-point samples of twice as many random points, which cover the surface evenly, so that draws
            resemble each other. Good to sample with; to learn from, draws that differ more are better (measured).
    """
    count = settings.points
    enough = np.concatenate([rng.permutation(len(points)) for _ in range(-(-count // len(points)))])
    if even:
        part = points[enough[: max(count, min(2 * count, len(points)))]]
        ordered = part[farthest_points(part, count)]
    else:
        part = points[enough[:count]]
        first = farthest_points(part, settings.centres[0])
        rest = np.setdiff1d(np.arange(count), first)
        ordered = part[np.concatenate([first, rest])[:count]]
    level, found = ordered, []
    for centres, radius, count in zip(settings.centres, settings.radii, settings.neighbours, strict=True):
        found.append(neighbourhoods(level, centres, radius, count)[None])
        level = level[:centres]
    return Clouds(ordered[None].astype(np.float32), tuple(found))


def stack(clouds: list[Clouds]) -> Clouds:
    """Join clouds of the same settings."""
    levels = len(clouds[0].neighbours)
    return Clouds(
        np.concatenate([cloud.points for cloud in clouds]),
        tuple(np.concatenate([cloud.neighbours[level] for cloud in clouds]) for level in range(levels)),
    )
