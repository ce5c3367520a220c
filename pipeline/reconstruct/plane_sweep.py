"""Depth maps by correlation: a sweep of planes through a box, then a sweep along the surface that was found.

For every pixel, windows of other photos are compared with its own window as they would look if the surface lay at a
tried depth; the depth at which they correlate best is kept. In the first sweep all windows face the camera; in the
second they follow the surface of the first, so that slanted sides are matched without bias.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from pipeline.reconstruct.views import View
from pipeline.records.parameters.reconstruct import SweepParameters

LEAST_CONTRAST = 0.008  # standard deviation of a window's brightness (0 to 1) that can be told from noise
SECOND_REACH = 0.004  # m, that the second sweep looks to both sides of the first surface
SECOND_STEPS = 25
SECOND_ANGLE = 75.0  # degrees between ray and normal beyond which a surface is seen too flatly
SMALLEST_ANGLE, LARGEST_ANGLE = 3.0, 50.0  # degrees between photos that are compared
LEAST_TELLING = 60  # windows with contrast that two photos must share to be called alike or not
# A pixel shows the support where the plane explains it nearly as well (correlation) as the best depth: along the edges
# of shadows and on faint paper, many depths do. It plainly shows it where the plane alone explains it well.
SUPPORT_NEARLY, SUPPORT_PLAINLY = 0.15, 0.8
LIKENESS_PERCENTILE = 80  # of their correlations: the lower ones may still be covered by something else


@dataclass(frozen=True)
class Window:
    """A rectangle of a photo's pixels."""

    left: int
    top: int
    width: int
    height: int

    def of(self, image: NDArray[Any]) -> NDArray[Any]:
        """Return this part of an image (h, w)."""
        return np.ascontiguousarray(image[self.top : self.top + self.height, self.left : self.left + self.width])

    def centres(self) -> NDArray[np.float64]:
        """Return pixel positions (h * w, 2), centres at .5."""
        x, y = np.meshgrid(self.left + np.arange(self.width) + 0.5, self.top + np.arange(self.height) + 0.5)
        return np.stack([x, y], axis=-1).reshape(-1, 2)


@dataclass(frozen=True)
class DepthMap:
    """Depths of the pixels of one window of one view."""

    view: int
    window: Window
    depth: NDArray[np.float32]  # (h, w), m along the optical axis; 0 where unknown
    score: NDArray[np.float32]  # (h, w), correlation, -1 to 1
    # Per other view that shares enough of a known surface that was followed: its number, and how alike they are there.
    likeness: tuple[tuple[int, float], ...] = ()
    support: NDArray[np.bool_] | None = None  # (h, w) where the support itself is plainly seen


def window_of(view: View, corners: NDArray[np.float64], padding: int) -> tuple[Window, float, float] | None:
    """Return the rectangle that shows ``corners`` (8, 3), and their nearest and farthest depth; None if out of view."""
    pixels, depth = view.project(corners)
    if depth.min() <= 0.02:
        return None
    height, width = view.image.shape
    left, top = np.floor(pixels.min(axis=0)).astype(int) - padding
    right, bottom = np.ceil(pixels.max(axis=0)).astype(int) + padding
    whole = (right - left) * (bottom - top)
    left, top, right, bottom = max(left, 0), max(top, 0), min(right, width), min(bottom, height)
    if right - left < 8 or bottom - top < 8 or (right - left) * (bottom - top) < 0.3 * whole:
        return None
    return Window(left, top, right - left, bottom - top), float(depth.min()), float(depth.max())


def neighbours(
    views: Sequence[View], view: int, middle: NDArray[np.float64], visible: Sequence[int], settings: SweepParameters
) -> list[int]:
    """Return the views whose angle to ``view``, seen from ``middle`` (3,), is nearest to the baseline looked for."""
    own = views[view].centre - middle
    angles = {}
    for other in visible:
        if other != view:
            its = views[other].centre - middle
            cosine = own @ its / np.linalg.norm(own) / np.linalg.norm(its)
            angles[other] = float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    useful = [other for other, angle in angles.items() if SMALLEST_ANGLE < angle < LARGEST_ANGLE]
    return sorted(useful, key=lambda other: abs(angles[other] - settings.baseline_degrees))[: settings.neighbours]


class _Reference:
    """The window of the photo whose depths are looked for, with its moments."""

    def __init__(self, image: NDArray[np.float32], size: int) -> None:
        self.size, self.image = (size, size), image
        self.mean = cv2.boxFilter(image, cv2.CV_32F, self.size)
        self.variance = np.maximum(cv2.boxFilter(image * image, cv2.CV_32F, self.size) - self.mean**2, 0)

    def correlation(self, warped: NDArray[Any]) -> NDArray[np.float32]:
        """Return the normalised cross-correlation (h, w) with a warped photo; -1 where it shows nothing (NaN)."""
        outside = np.isnan(warped)
        any_outside = bool(outside.any())
        if any_outside:
            warped = np.where(outside, np.float32(0), warped)
        mean = cv2.boxFilter(warped, cv2.CV_32F, self.size)
        variance = cv2.boxFilter(warped * warped, cv2.CV_32F, self.size) - mean * mean
        product = cv2.boxFilter(warped * self.image, cv2.CV_32F, self.size) - mean * self.mean
        score = product / np.sqrt(np.maximum(variance * self.variance, np.float32(1e-10)))
        if any_outside:
            score[cv2.boxFilter(outside.astype(np.float32), cv2.CV_32F, self.size) > 0] = -1
        return np.asarray(score, np.float32)


def _best_half(scores: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the mean (h, w) of the better half of ``scores`` (n, h, w): a neighbour that is covered must not count."""
    count = (len(scores) + 1) // 2
    if count < len(scores):
        scores = np.partition(scores, len(scores) - count, axis=0)[len(scores) - count :]
    return np.asarray(scores.mean(axis=0), np.float32)


def _peak(volume: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the position (h, w), in planes and fractions, of the best score in ``volume`` (planes, h, w), and it."""
    best = volume.argmax(axis=0)
    inside = np.clip(best, 1, len(volume) - 2)
    before, at, after = (np.take_along_axis(volume, (inside + k)[None], axis=0)[0] for k in (-1, 0, 1))
    curve = before - 2 * at + after
    shift = np.where(curve < -1e-6, 0.5 * (before - after) / np.where(curve < -1e-6, curve, -1), 0)
    shift = np.where(best == inside, np.clip(shift, -0.5, 0.5), 0)
    return (best + shift).astype(np.float32), np.take_along_axis(volume, best[None], axis=0)[0]


def _kept(
    view: View, window: Window, reference: _Reference, score: NDArray[np.float32], least: float
) -> NDArray[np.bool_]:
    """Return where (h, w) a depth can be believed: it correlates, and the window shows something."""
    good = (score >= least) & (reference.variance > LEAST_CONTRAST**2)
    if view.usable is not None:
        good &= window.of(view.usable)
    return np.asarray(good)


def _homographies(
    own: View, others: Sequence[View], window: Window
) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return per other view the homography (3, 3) of the plane at infinity and the epipole (3,).

    They lead from OpenCV's indices within the window to those of the other photo. For the plane at a depth d, the
    epipole / d is added to the last column.
    """
    from_window = np.array([[1, 0, window.left + 0.5], [0, 1, window.top + 0.5], [0, 0, 1.0]])
    to_index = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1.0]])  # pixel centres lie at .5, OpenCV's at whole numbers
    found = []
    for other in others:
        relative = other.T_camera_scene @ np.linalg.inv(own.T_camera_scene)
        infinite = to_index @ other.K @ relative[:3, :3] @ np.linalg.inv(own.K) @ from_window
        found.append((infinite, to_index @ other.K @ relative[:3, 3]))
    return found


def support_score(
    views: Sequence[View],
    view: int,
    others: Sequence[int],
    window: Window,
    reference: _Reference,
    support: float,
) -> NDArray[np.float32]:
    """Return how well (h, w) other photos show the same if all pixels of a window show the plane z = ``support``."""
    own, compared = views[view], [views[other] for other in others]
    from_window = np.array([[1, 0, window.left + 0.5], [0, 1, window.top + 0.5], [0, 0, 1.0]])
    up = own.T_camera_scene[:3, 2]
    distance = float(up @ (own.T_camera_scene[:3, 3] + support * up))  # of the plane along its normal
    across = (up / distance) @ np.linalg.inv(own.K) @ from_window
    scores = [
        reference.correlation(_warped(other.image, infinite + np.outer(epipole, across), window))
        for other, (infinite, epipole) in zip(compared, _homographies(own, compared, window), strict=True)
    ]
    return np.asarray(cv2.boxFilter(_best_half(np.array(scores)), cv2.CV_32F, (3, 3)), np.float32)


def _warped(image: NDArray[np.float32], homography: NDArray[np.float64], window: Window) -> NDArray[Any]:
    """Return what a photo shows where a homography leads from the window's pixels; NaN outside of it."""
    return cv2.warpPerspective(
        image,
        homography,
        (window.width, window.height),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=float("nan"),
    )


def sweep(
    views: Sequence[View],
    view: int,
    others: Sequence[int],
    window: Window,
    nearest: float,
    farthest: float,
    settings: SweepParameters,
    support: float | None = None,
) -> DepthMap:
    """Return the depths of one window, from planes that face the camera.

    Args:
        others: indices of the views it is compared with, at least one.
        nearest: smallest depth tried, m; ``farthest`` the largest. Planes are spaced evenly in inverse depth.
        support: z of the plane on which objects stand, m: what shows it gets no depth.
    """
    own, compared = views[view], [views[other] for other in others]
    reference = _Reference(window.of(own.image), settings.window)
    homographies = _homographies(own, compared, window)
    inverse = np.linspace(1 / nearest, 1 / farthest, settings.planes)
    volume = np.empty((settings.planes, window.height, window.width), np.float32)
    scores = np.empty((len(others), window.height, window.width), np.float32)
    for plane, inverse_depth in enumerate(inverse):
        for index, (infinite, epipole) in enumerate(homographies):
            homography = infinite.copy()
            homography[:, 2] += inverse_depth * epipole
            warped = _warped(compared[index].image, homography, window)
            scores[index] = reference.correlation(warped)
        volume[plane] = cv2.boxFilter(_best_half(scores), cv2.CV_32F, (3, 3))
    position, score = _peak(volume)
    depth = 1 / np.interp(position, np.arange(settings.planes), inverse)
    ends = (position < 0.5) | (position > settings.planes - 1.5)
    good = _kept(own, window, reference, score, settings.least_correlation) & ~ends
    seen = None
    if support is not None:
        on_it = support_score(views, view, others, window, reference, support)
        good &= ~((on_it > settings.least_correlation) & (on_it > score - SUPPORT_NEARLY))
        plain = (on_it > SUPPORT_PLAINLY) & (on_it > score - SUPPORT_NEARLY) & (reference.variance > LEAST_CONTRAST**2)
        # A window at an object's outline may follow the support's texture: only what lies wholly on it counts.
        seen = cv2.erode(plain.astype(np.uint8), np.ones((settings.window, settings.window), np.uint8)) > 0
    return DepthMap(view, window, np.where(good, depth, 0).astype(np.float32), score, (), seen)


@dataclass(frozen=True)
class _Lines:
    """Where another photo shows the pixels of a window, by their depth."""

    image: NDArray[np.float32]
    directions: NDArray[np.float32]  # (h * w, 3): homogeneous pixel = direction * depth + start
    start: NDArray[np.float32]  # (3,)

    @staticmethod
    def between(own: View, other: View, window: Window) -> _Lines:
        """Return the lines of one other view."""
        rays = np.concatenate([window.centres(), np.ones((window.width * window.height, 1))], axis=1)
        rays = rays @ np.linalg.inv(own.K).T
        relative = other.T_camera_scene @ np.linalg.inv(own.T_camera_scene)
        directions = rays @ (other.K @ relative[:3, :3]).T
        return _Lines(other.image, directions.astype(np.float32), (other.K @ relative[:3, 3]).astype(np.float32))

    def warped(self, depth: NDArray[np.float32]) -> NDArray[Any]:
        """Return what the photo shows where the window's pixels have ``depth`` (h, w); NaN outside of it."""
        pixels = self.directions * depth.reshape(-1, 1) + self.start
        place = (pixels[:, :2] / pixels[:, 2:] - np.float32(0.5)).reshape(*depth.shape, 2)
        columns, rows = np.ascontiguousarray(place[..., 0]), np.ascontiguousarray(place[..., 1])
        return cv2.remap(
            self.image, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=float("nan")
        )


def _likeness(
    others: Sequence[int], scores: NDArray[np.float32], telling: NDArray[np.bool_]
) -> tuple[tuple[int, float], ...]:
    """Return how alike the window and each photo are on a known surface, for photos that share enough of it.

    Args:
        scores: (photos, h, w) correlations on that surface.
        telling: (photos, h, w) where both see it, and it shows something.
    """
    return tuple(
        (other, float(np.percentile(score[both], LIKENESS_PERCENTILE)))
        for other, score, both in zip(others, scores, telling, strict=True)
        if both.sum() >= LEAST_TELLING
    )


def follow(
    views: Sequence[View],
    view: int,
    others: Sequence[int],
    window: Window,
    base: NDArray[np.float32],
    visible: NDArray[np.bool_],
    settings: SweepParameters,
    support: float | None = None,
) -> DepthMap:
    """Return the depths of one window, looked for on surfaces parallel to a known one near by.

    Args:
        base: (h, w) depths of the known surface, m; 0 where it is not seen or seen too flatly.
        visible: (others, h, w) where the other views see that surface too, by what is known so far.
        support: see :func:`sweep`.
    """
    own, seen = views[view], base > 0
    if not seen.any():
        empty = np.zeros(base.shape, np.float32)
        return DepthMap(view, window, empty, empty)
    reference = _Reference(window.of(own.image), settings.window)
    # Windows reach beyond the surface's outline and over what is seen too flatly: it goes on there as at its edge.
    nearest = distance_transform_edt(~seen, return_distances=False, return_indices=True)
    extended = base[tuple(nearest)]
    lines = [_Lines.between(own, views[other], window) for other in others]
    offsets = np.linspace(-SECOND_REACH, SECOND_REACH, SECOND_STEPS)
    volume = np.empty((SECOND_STEPS, window.height, window.width), np.float32)
    likeness: tuple[tuple[int, float], ...] = ()
    for step, offset in enumerate(offsets):
        scores = np.array([reference.correlation(line.warped(extended + np.float32(offset))) for line in lines])
        if step == SECOND_STEPS // 2:
            likeness = _likeness(others, scores, visible & seen & (reference.variance > LEAST_CONTRAST**2))
        volume[step] = cv2.boxFilter(_best_half(scores), cv2.CV_32F, (3, 3))
    position, score = _peak(volume)
    depth = base + np.interp(position, np.arange(SECOND_STEPS), offsets).astype(np.float32)
    ends = (position < 0.5) | (position > SECOND_STEPS - 1.5)
    good = _kept(own, window, reference, score, settings.least_correlation) & ~ends & seen
    if support is not None:
        on_it = support_score(views, view, others, window, reference, support)
        good &= ~((on_it > settings.least_correlation) & (on_it > score - SUPPORT_NEARLY))
    return DepthMap(view, window, np.where(good, depth, 0).astype(np.float32), score, likeness)
