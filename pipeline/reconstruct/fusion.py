"""Points on which depth maps agree, and how much they contradict each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.reconstruct.plane_sweep import DepthMap, Window
from pipeline.reconstruct.views import View
from pipeline.records.parameters.reconstruct import SweepParameters

THROUGH = 0.008  # m: a photo that sees this much deeper than a point looks through it
# A point is dropped when more photos look through it, or show the support behind it, than this many times those that
# confirm it. Below the height at which the two can be told apart, the support does not count.
LARGEST_AGAINST, TOLD_APART = 0.5, 0.006  # m
LEAST_SHARED = 60  # sightings that two photos must share to agree or to contradict each other


@dataclass(frozen=True)
class Points:
    """Measured surface points."""

    positions: NDArray[np.float64]  # (n, 3), scene frame
    towards: NDArray[np.float64]  # (n, 3) unit, to the cameras that saw them
    seen_through: float  # share of the sightings of points in which a photo sees something deeper instead
    # Per pair of photos that share enough, the share of the sightings in which they contradict each other.
    contradictions: tuple[tuple[int, int, float], ...] = ()


def _lookup(window: Window, values: NDArray[Any], pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``values`` (h, w) of a window at ``pixels`` (n, 2), 0 outside."""
    column = np.floor(pixels[:, 0]).astype(np.int64) - window.left
    row = np.floor(pixels[:, 1]).astype(np.int64) - window.top
    inside = (column >= 0) & (column < window.width) & (row >= 0) & (row < window.height)
    found = np.zeros(len(pixels))
    found[inside] = values[row[inside], column[inside]]
    return found


def support_shares(
    points: NDArray[np.float64], views: Sequence[View], maps: Sequence[DepthMap], agreement: float
) -> NDArray[np.int64]:
    """Return how many photos (n,) measured a depth within ``agreement`` (m) of points (n, 3) of a surface."""
    count = np.zeros(len(points), np.int64)
    for depth in maps:
        pixels, its = views[depth.view].project(points)
        measured = _lookup(depth.window, depth.depth, pixels)
        count += (measured > 0) & (np.abs(measured - its) < agreement)
    return count


def fuse(
    views: Sequence[View],
    maps: Sequence[DepthMap],
    settings: SweepParameters,
    plainly: Sequence[DepthMap] = (),
    support: float = 0.0,
) -> Points:
    """Return the points that at least ``least_agreeing`` other depth maps confirm, averaged along the rays.

    Args:
        plainly: maps that tell where the support is plainly seen; a point before it is none.
        support: z of the support, m.
    """
    positions, towards, pairs = [np.zeros((0, 3))], [np.zeros((0, 3))], []
    agreeing, through = 0, 0
    for depth in maps:
        view = views[depth.view]
        known = depth.depth.reshape(-1) > 0
        pixels = depth.window.centres()[known]
        own = depth.depth.reshape(-1)[known].astype(np.float64)
        points = view.lift(pixels, own)
        total, count = own.copy(), np.ones(len(own))
        against, votes = np.zeros(len(own)), {}
        for other in maps:
            if other.view == depth.view:
                continue
            its_pixels, its_depth = views[other.view].project(points)
            measured = _lookup(other.window, other.depth, its_pixels)
            agrees = (measured > 0) & (np.abs(measured - its_depth) < settings.agreement)
            deeper = (measured > 0) & (measured > its_depth + THROUGH)
            votes[other.view] = (agrees, deeper)
            against += deeper
            # What the other measured, back in this view, is another measurement of this pixel's depth.
            lifted = views[other.view].lift(its_pixels[agrees], measured[agrees])
            total[agrees] += view.project(lifted)[1]
            count[agrees] += 1
        confirmed = count > settings.least_agreeing
        agreeing += int((count[confirmed] - 1).sum())
        through += int(against[confirmed].sum())
        pairs += _contradictions(depth.view, votes, confirmed)
        high = points[:, 2] > support + TOLD_APART
        for other in plainly:
            if other.support is not None:
                shown = _lookup(other.window, other.support, views[other.view].project(points)[0])
                against += high & (shown > 0)
        good = confirmed & (against <= LARGEST_AGAINST * (count - 1))
        mean = view.lift(pixels[good], (total / count)[good])
        direction = view.centre - mean
        positions.append(mean)
        towards.append(direction / np.linalg.norm(direction, axis=1, keepdims=True))
    whole = through / max(agreeing + through, 1)
    return Points(np.concatenate(positions), np.concatenate(towards), whole, tuple(pairs))


def _contradictions(
    view: int, votes: dict[int, tuple[NDArray[np.bool_], NDArray[np.bool_]]], confirmed: NDArray[np.bool_]
) -> list[tuple[int, int, float]]:
    found = []
    for other, (agrees, deeper) in votes.items():
        for_it, against_it = int((agrees & confirmed).sum()), int((deeper & confirmed).sum())
        if for_it + against_it >= LEAST_SHARED:
            found.append((view, other, against_it / (for_it + against_it)))
    return found


def thinned(points: Points, cell: float) -> Points:
    """Return the means of the points in every cell of a grid, in the order of the cells."""
    keys = np.floor(points.positions / cell).astype(np.int64)
    _, place, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    place = place.reshape(-1)

    def mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack([np.bincount(place, values[:, axis], len(count)) for axis in range(3)], axis=1) / count[:, None]

    towards = mean(points.towards)
    towards /= np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-9)
    return replace(points, positions=mean(points.positions), towards=towards)
