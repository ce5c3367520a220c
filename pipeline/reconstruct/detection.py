"""Tags in one photo: AprilTags and ArUco markers, and their corners to a fraction of a pixel."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.records.tag_layouts import TAG_FAMILIES, TagLayout, opencv_name

PROFILES = 24  # per edge
LARGE, SMALL = 2000, 1000  # pixels: a photo with a longer side is searched at half size too, a smaller one doubled
# Windows (pixels) of the thresholds that are tried. Small tags before a mixed background need more of them.
WINDOWS, DENSE_WINDOWS = (3, 23, 10), (3, 53, 5)
# Tried when no tag of the stated family is seen; ArUco's families of one grid size are beginnings of the largest.
LARGEST_FAMILIES = tuple(
    name for name in TAG_FAMILIES if not name.startswith("aruco_") or name.endswith(("_1000", "_original"))
)
LEAST_TO_NAME = 2  # tags of another family seen in a photo: one alone may be chance

Sightings = dict[int, NDArray[np.float64]]


@dataclass(frozen=True)
class Sighting:
    """One tag in one photo."""

    number: int
    corners: NDArray[np.float64]  # (4, 2) pixels, centres at .5, in OpenCV's order


def refined_corners(light: NDArray[np.float32], corners: NDArray[np.float64], cells: int) -> NDArray[np.float64]:
    """Return the corners (4, 2) of a black square as the meeting points of its four edges, pixel centres at .5.

    Each edge is a line through the places where light changes fastest, on profiles across it. Corners found directly
    are biased towards the inside (by 0.4 pixels in a test), which makes the whole scene too large.

    Args:
        light: (h, w) linear brightness: in gamma-coded values a blurred edge seems to lie towards the dark side.
        corners: (4, 2) first guess, within a pixel or two.
        cells: how many the black square is wide.
    """
    lines = np.zeros((4, 3))
    for k in range(4):
        begin, end = corners[k], corners[(k + 1) % 4]
        along = end - begin
        length = float(np.linalg.norm(along))
        along = along / length
        across = np.array([-along[1], along[0]])
        reach = min(max(0.45 * length / cells, 1.5), 6.0)  # stays within the black border and the white one
        places = begin + along * np.linspace(0.08, 0.92, PROFILES)[:, None] * length
        steps = np.linspace(-reach, reach, 33)
        pixels = (places[:, None] + across * steps[:, None] - 0.5).astype(np.float32)
        profile = cv2.remap(light, pixels[..., 0], pixels[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        slope = np.abs(np.diff(profile, axis=1))
        slope = np.where(slope > 0.3 * slope.max(axis=1, keepdims=True), slope, 0)
        middle = (steps[1:] + steps[:-1]) / 2
        offset = (slope * middle).sum(axis=1) / np.maximum(slope.sum(axis=1), 1e-9)
        position = np.linspace(0.08, 0.92, PROFILES) * length
        good = np.abs(offset - np.median(offset)) < 1.0
        for _ in range(3):
            if good.sum() < PROFILES // 3:
                return corners
            tilt, shift = np.polyfit(position[good], offset[good], 1)
            error = np.abs(offset - tilt * position - shift)
            good = error <= max(3 * float(np.median(error)), 0.05)
        first, last = begin + across * shift, end + across * (shift + tilt * length)
        lines[k] = np.cross([*first, 1.0], [*last, 1.0])
    met = np.array([np.cross(lines[(k - 1) % 4], lines[k]) for k in range(4)])
    if np.abs(met[:, 2]).min() < 1e-12:
        return corners
    refined = met[:, :2] / met[:, 2:]
    return np.asarray(refined if np.linalg.norm(refined - corners, axis=1).max() < 3.0 else corners)


def _detector(family: str, border: int, windows: tuple[int, int, int]) -> Any:
    options = cv2.aruco.DetectorParameters()
    options.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
    options.markerBorderBits = border
    options.adaptiveThreshWinSizeMin, options.adaptiveThreshWinSizeMax, options.adaptiveThreshWinSizeStep = windows
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, opencv_name(family)))
    return cv2.aruco.ArucoDetector(dictionary, options)


def _resized(grey: NDArray[np.uint8], factor: float, how: int) -> NDArray[np.uint8]:
    return np.asarray(cv2.resize(grey, None, fx=factor, fy=factor, interpolation=how), np.uint8)


def _levels(grey: NDArray[np.uint8]) -> Iterable[tuple[NDArray[np.uint8], float, tuple[int, int, int]]]:
    """Return the photo at the sizes at which it is searched, how often each is as large, and the windows to try."""
    side = max(grey.shape)
    yield grey, 1.0, WINDOWS
    if side < SMALL:
        yield _resized(grey, 2.0, cv2.INTER_CUBIC), 2.0, DENSE_WINDOWS
    factor = 1.0
    while side * factor > LARGE:
        factor /= 2
        yield _resized(grey, factor, cv2.INTER_AREA), factor, WINDOWS


def all_tags(grey: NDArray[np.uint8], family: str, border: int = 1) -> list[Sighting]:
    """Return every tag of a family in a photo (h, w), also one whose number is seen several times.

    The photo is searched at its full size, and at others: fine texture inside of large tags hides their outline at
    full size, and small tags are not found without doubling.
    """
    found: list[tuple[int, NDArray[np.float64]]] = []
    for level, factor, windows in _levels(grey):
        corners, numbers, _ = _detector(family, border, windows).detectMarkers(level)
        for number, corner in zip(() if numbers is None else numbers.ravel(), corners, strict=False):
            # OpenCV counts pixels from their centres.
            places = (corner.reshape(4, 2).astype(np.float64) + 0.5) / factor
            side = np.linalg.norm(places[0] - places[2])
            known = (np.linalg.norm(places.mean(axis=0) - its.mean(axis=0)) for n, its in found if n == number)
            if all(distance > side / 4 for distance in known):
                found.append((int(number), places))
    light = np.asarray((grey / np.float32(255)) ** np.float32(2.2), np.float32)
    cells = TAG_FAMILIES[family][1] + 2 * border
    return [Sighting(number, refined_corners(light, places, cells)) for number, places in found]


@dataclass(frozen=True)
class Seen:
    """The tags of a layout in one photo."""

    tags: Sightings  # per tag its corners (4, 2), pixels of the photo as it is worked with, centres at .5
    repeated: tuple[int, ...] = ()  # seen several times in this photo, and left out: which one is meant is unknown


def seen_tags(grey: NDArray[np.uint8], layout: TagLayout, times: int = 1) -> Seen:
    """Return the tags of a layout in a photo (h, w) at its full size.

    Args:
        times: by which the photo is shrunk for the work that follows; the corners are those of the shrunk one.
    """
    wanted = layout.numbers()
    found = [one for one in all_tags(grey, layout.family, layout.border) if one.number in wanted]
    counts = Counter(one.number for one in found)
    return Seen(
        {one.number: one.corners / times for one in found if counts[one.number] == 1},
        tuple(sorted(number for number, count in counts.items() if count > 1)),
    )


def family_seen(photos: Iterable[NDArray[np.uint8]], stated: str) -> str | None:
    """Return the family whose tags are in the photos instead of the stated one, None when none is found.

    The one with the most sightings counts: tags of 4 x 4 cells are found by chance where others are.
    """
    counts: Counter[str] = Counter()
    for grey in photos:
        for family in LARGEST_FAMILIES:
            if family == stated or (stated.startswith("aruco_") and stated[:9] == family[:9]):
                continue
            corners, numbers, _ = _detector(family, 1, WINDOWS).detectMarkers(grey)
            if numbers is not None and len(numbers) >= LEAST_TO_NAME:
                counts[family] += len(numbers)
    return max(counts, key=lambda family: counts[family]) if counts else None
