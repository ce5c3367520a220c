"""Where no object can be: photos that see the pattern on the support look through all that lies before it.

A sheet of tags, a newspaper or a patterned cloth looks the same in all photos once each is drawn as seen from above.
What most of them agree on is the support's own look; where a photo shows that, nothing stands between it and the
support. Space through which photos look so cannot belong to an object; what is left bounds the object, as silhouettes
do, but needs no masks. Nothing is concluded from a support without a pattern, nor from shadows, which hide it.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter, map_coordinates

from pipeline.reconstruct.views import View
from pipeline.records.captures import SceneObject

PATTERN_CELL = 0.0005  # m, of the support as seen from above
BODY_CELL = 0.001  # m, of the space of an object
REACH = 1.5  # heights of an object around it, where photos see the support behind it
WIDE, NARROW = 11, 5  # cells of the windows that are compared with the support's own look
SAME = 0.85  # correlation of a window that shows it
LEAST_PATTERN = 0.06  # standard deviation of the brightness (0 to 1) of a window: an object's shading has less
ALIKE = 0.08  # of brightness, between cells of a plain patch and the support's own look
AGREED = 0.4  # of the photos that show a window must show the same, or it is no support but what covers it in most
STEEPEST = 0.2  # sine of the angle below which a photo sees the support too flatly
LEAST_LOOKS = 2  # photos that must look through a place; one does that looks past by more than a trifle
LOOKING = 12  # photos whose median is the support's own look
COARSE = 4  # cells, of which one tells exposures apart
DARK = 0.1  # brightness below which a cell does not tell them
FARTHEST = 0.02  # m, that a point of a surface may be moved
LOWEST = 0.003  # m above the support, from which on one can look through a place


@dataclass(frozen=True)
class Bound:
    """How far an object may reach."""

    origin: NDArray[np.float64]  # (3,), middle of the first cell, scene frame
    outside: NDArray[np.float32]  # (nx, ny, nz), m from what is left, negative within

    def distance(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far (n,) scene points (n, 3) lie outside, m; negative within."""
        at = ((points - self.origin) / BODY_CELL).T
        return np.asarray(map_coordinates(self.outside, at, order=1, mode="nearest"), np.float64)

    def drawn_in(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return scene points (n, 3), those outside moved towards the middle of all until they are within.

        Where that is farther than ``FARTHEST``, a point stays.
        """
        moved = np.array(points)
        far = np.flatnonzero(self.distance(points) > BODY_CELL / 2)
        inwards = points.mean(axis=0) - points[far]
        inwards /= np.maximum(np.linalg.norm(inwards, axis=1, keepdims=True), 1e-9)
        for step in np.arange(BODY_CELL / 2, FARTHEST, BODY_CELL / 2):
            tried = points[far] + step * inwards
            within = self.distance(tried) <= BODY_CELL / 2
            moved[far[within]] = tried[within]
            far, inwards = far[~within], inwards[~within]
        return moved


@dataclass(frozen=True)
class _Plan:
    """A grid on the support, seen from above."""

    low: NDArray[np.float64]  # (2,), corner, m
    shape: tuple[int, int]  # rows along y, columns along x
    support: float  # z, m

    @staticmethod
    def around(item: SceneObject, support: float) -> _Plan:
        """Return the grid around an object."""
        corners = item.corners(support, 0.0)
        reach = REACH * item.box[2] + 0.02
        low, high = corners[:, :2].min(axis=0) - reach, corners[:, :2].max(axis=0) + reach
        columns, rows = np.ceil((high - low) / PATTERN_CELL).astype(int)
        return _Plan(low, (int(rows), int(columns)), support)

    def drawn(self, view: View) -> NDArray[np.float32]:
        """Return what a photo shows (rows, columns) of the support; NaN where it does not."""
        R, t = view.T_camera_scene[:3, :3], view.T_camera_scene[:3, 3]
        start = R @ np.array([*self.low, self.support]) + t
        to_camera = np.column_stack([R[:, 0] * PATTERN_CELL, R[:, 1] * PATTERN_CELL, start])
        half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1.0]])
        homography = np.linalg.inv(half) @ view.K @ to_camera @ half
        image = view.image if view.usable is None else np.where(view.usable, view.image, np.float32("nan"))
        return np.asarray(
            cv2.warpPerspective(
                image,
                homography,
                self.shape[::-1],
                flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
                borderMode=cv2.BORDER_CONSTANT,
                borderValue=float("nan"),
            )
        )

    def cells(self, along: NDArray[np.float64], axis: int) -> NDArray[np.int64]:
        """Return the column (``axis`` 0) or row (1) of places (n,) along an axis; -1 off the grid."""
        found = np.floor((along - self.low[axis]) / PATTERN_CELL).astype(np.int64)
        return np.where((found >= 0) & (found < self.shape[1 - axis]), found, -1)


def _own_look(drawn: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the support's look (rows, columns), and the photos (n, rows, columns) with one exposure."""
    some = drawn[:: -(-len(drawn) // LOOKING)]
    with warnings.catch_warnings(action="ignore", category=RuntimeWarning):  # cells that no photo shows
        first = np.nanmedian(some[:, ::COARSE, ::COARSE], axis=0)
        bright = first > DARK
        ratios = first[bright] / np.maximum(drawn[:, ::COARSE, ::COARSE][:, bright], DARK / 2)
        gains = np.nan_to_num(np.nanmedian(ratios, axis=1), nan=1.0).astype(np.float32)
        look = np.nanmedian(some * gains[:: -(-len(drawn) // LOOKING), None, None], axis=0)
    return np.asarray(look, np.float32), drawn * gains[:, None, None]


def _same(one: NDArray[np.float32], other: NDArray[np.float32], size: int) -> NDArray[np.bool_]:
    """Return where (rows, columns) windows correlate, and ``other`` shows a pattern."""

    def mean(values: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(cv2.boxFilter(values, cv2.CV_32F, (size, size)))

    a, b = mean(one), mean(other)
    of_one, of_other = mean(one * one) - a * a, mean(other * other) - b * b
    found = (mean(one * other) - a * b) / np.sqrt(np.maximum(of_one * of_other, 1e-10))
    return np.asarray((of_other > LEAST_PATTERN**2) & (found > SAME))


def _grown(values: NDArray[np.bool_], size: int) -> NDArray[np.bool_]:
    return np.asarray(cv2.dilate(values.astype(np.uint8), np.ones((size, size), np.uint8)) > 0)


def _shown(drawn: NDArray[np.float32], look: NDArray[np.float32]) -> list[NDArray[np.uint8]]:
    """Return per photo where (rows, columns) it shows the support itself, as 0 and 1."""
    images, own = np.nan_to_num(drawn), np.nan_to_num(look)
    known = [~_grown(np.isnan(one) | np.isnan(look), WIDE) for one in drawn]
    wide = [near & _same(one, own, WIDE) for one, near in zip(images, known, strict=True)]
    agreed = np.sum(wide, axis=0) > AGREED * np.sum(known, axis=0)
    found = []
    for one, near, its in zip(images, known, wide, strict=True):
        sure = its & agreed
        narrow = near & _grown(sure, WIDE) & _same(one, own, NARROW)
        # Plain patches between: of the same brightness, with what surely is the support at most a window away.
        plain = near & _grown(sure | narrow, NARROW) & (np.abs(one - own) < ALIKE)
        shown = ((sure & _grown(narrow | plain, 3)) | narrow | plain) & (np.abs(one - own) < 3 * ALIKE)
        opened = cv2.morphologyEx(shown.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        found.append(np.asarray(opened, np.uint8))
    return found


def bound_of(views: Sequence[View], item: SceneObject, support: float, margin: float) -> Bound | None:
    """Return how far an object may reach; None where the support shows no pattern that most photos agree on.

    Args:
        support: z of the plane on which it stands, m.
        margin: m around its box, that may belong to it.
    """
    plan = _Plan.around(item, support)
    middle = item.corners(support, 0.0).mean(axis=0)
    looking = [view for view in views if (view.centre - middle)[2] > STEEPEST * np.linalg.norm(view.centre - middle)]
    if len(looking) <= LEAST_LOOKS:
        return None
    look, evened = _own_look(np.array([plan.drawn(view) for view in looking]))
    corners = item.corners(support, margin)
    low, high = corners.min(axis=0), corners.max(axis=0)
    axes = [np.arange(low[axis], high[axis] + BODY_CELL, BODY_CELL) for axis in range(3)]
    looks = np.zeros([len(axis) for axis in axes], np.uint8)
    for view, shown in zip(looking, _shown(evened, look), strict=True):
        _look_through(looks, axes, view, shown, plan)
    lowest = int(np.searchsorted(axes[2], support + LOWEST, side="right"))
    left = looks < LEAST_LOOKS
    left[:, :, :lowest] = left[:, :, lowest, None]  # below, nobody can look through: as right above
    if left.all() or not left.any():
        return None
    off = distance_transform_edt(~left, BODY_CELL) - distance_transform_edt(left, BODY_CELL)
    return Bound(low, np.asarray(gaussian_filter(off.astype(np.float32), 1.0)))


def _look_through(
    looks: NDArray[np.uint8],
    axes: Sequence[NDArray[np.float64]],
    view: View,
    shown: NDArray[np.uint8],
    plan: _Plan,
) -> None:
    """Count in ``looks`` (nx, ny, nz) where a photo looks through a place; twice where it does by a good deal."""
    sure = shown + cv2.erode(shown, np.ones((NARROW, NARROW), np.uint8))
    framed = np.pad(sure, ((0, 1), (0, 1)))  # -1 leads to the frame, where nothing is seen
    x, y, top = view.centre
    for level, z in enumerate(axes[2]):
        if plan.support + LOWEST < z < top:
            reach = (top - plan.support) / (top - z)
            columns = plan.cells(x + (axes[0] - x) * reach, 0)
            rows = plan.cells(y + (axes[1] - y) * reach, 1)
            looks[:, :, level] += framed[np.ix_(rows, columns)].T
