"""Points on which depth maps agree, and how much they contradict each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.reconstruct.plane_sweep import DepthMap
from pipeline.reconstruct.views import View
from pipeline.records.parameters.reconstruct import SweepParameters

THROUGH = 0.008  # m: a photo that sees this much deeper than a point looks through it


@dataclass(frozen=True)
class Points:
    """Measured surface points."""

    positions: NDArray[np.float64]  # (n, 3), scene frame
    towards: NDArray[np.float64]  # (n, 3) unit, to the cameras that saw them
    seen_through: float  # share of the sightings of points in which a photo sees something deeper instead


def _lookup(depth: DepthMap, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the depths (n,) at ``pixels`` (n, 2), 0 where unknown or outside."""
    column = np.floor(pixels[:, 0]).astype(np.int64) - depth.window.left
    row = np.floor(pixels[:, 1]).astype(np.int64) - depth.window.top
    inside = (column >= 0) & (column < depth.window.width) & (row >= 0) & (row < depth.window.height)
    found = np.zeros(len(pixels))
    found[inside] = depth.depth[row[inside], column[inside]]
    return found


def fuse(views: Sequence[View], maps: Sequence[DepthMap], settings: SweepParameters) -> Points:
    """Return the points that at least ``least_agreeing`` other depth maps confirm, averaged along the rays."""
    positions, towards = [np.zeros((0, 3))], [np.zeros((0, 3))]
    agreeing, through = 0, 0
    for depth in maps:
        view = views[depth.view]
        known = depth.depth.reshape(-1) > 0
        pixels = depth.window.centres()[known]
        own = depth.depth.reshape(-1)[known].astype(np.float64)
        points = view.lift(pixels, own)
        total, count = own.copy(), np.ones(len(own))
        deeper = np.zeros(len(own))
        for other in maps:
            if other.view == depth.view:
                continue
            its_pixels, its_depth = views[other.view].project(points)
            measured = _lookup(other, its_pixels)
            agrees = (measured > 0) & (np.abs(measured - its_depth) < settings.agreement)
            deeper += (measured > 0) & (measured > its_depth + THROUGH)
            # What the other measured, back in this view, is another measurement of this pixel's depth.
            lifted = views[other.view].lift(its_pixels[agrees], measured[agrees])
            total[agrees] += view.project(lifted)[1]
            count[agrees] += 1
        good = count > settings.least_agreeing
        agreeing += int((count[good] - 1).sum())
        through += int(deeper[good].sum())
        mean = view.lift(pixels[good], (total / count)[good])
        direction = view.centre - mean
        positions.append(mean)
        towards.append(direction / np.linalg.norm(direction, axis=1, keepdims=True))
    return Points(np.concatenate(positions), np.concatenate(towards), through / max(agreeing + through, 1))


def thinned(points: Points, cell: float) -> Points:
    """Return the means of the points in every cell of a grid, in the order of the cells."""
    keys = np.floor(points.positions / cell).astype(np.int64)
    _, place, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    place = place.reshape(-1)

    def mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack([np.bincount(place, values[:, axis], len(count)) for axis in range(3)], axis=1) / count[:, None]

    towards = mean(points.towards)
    towards /= np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-9)
    return Points(mean(points.positions), towards, points.seen_through)
