"""AprilTags: found in photos, and their corners located in space."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.reconstruct.photos import Photo
from pipeline.reconstruct.sparse import SparseView
from pipeline.records.captures import TagLayout
from pipeline.records.errors import UserError
from pipeline.records.parameters.reconstruct import AlignmentParameters

CELLS = 8  # of the edge of a tag of the family 36h11; fewer in the others
PROFILES = 24  # per edge

Sightings = dict[int, NDArray[np.float64]]


def refined_corners(light: NDArray[np.float32], corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the corners (4, 2) of a black square as the meeting points of its four edges, pixel centres at .5.

    Each edge is a line through the places where light changes fastest, on profiles across it. Corners found directly
    are biased towards the inside (by 0.4 pixels in a test), which makes the whole scene too large.

    Args:
        light: (h, w) linear brightness: in gamma-coded values a blurred edge seems to lie towards the dark side.
        corners: (4, 2) first guess, within a pixel or two.
    """
    lines = np.zeros((4, 3))
    for k in range(4):
        begin, end = corners[k], corners[(k + 1) % 4]
        along = end - begin
        length = float(np.linalg.norm(along))
        along = along / length
        across = np.array([-along[1], along[0]])
        reach = min(max(0.45 * length / CELLS, 1.5), 6.0)  # stays within the black border and the white one
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


def detect_tags(photo: Photo, layout: TagLayout) -> Sightings:
    """Return per tag of the layout seen its corners (4, 2), pixels with centres at .5, in OpenCV's order.

    A tag that is seen twice in one photo, printed twice or mistaken, is left out: which one is meant is unknown.
    """
    families = {
        "tag36h11": cv2.aruco.DICT_APRILTAG_36h11,
        "tag25h9": cv2.aruco.DICT_APRILTAG_25h9,
        "tag16h5": cv2.aruco.DICT_APRILTAG_16h5,
    }
    options = cv2.aruco.DetectorParameters()
    options.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(families[layout.family]), options)
    corners, numbers, _ = detector.detectMarkers(photo.grey)
    if numbers is None:
        return {}
    times = Counter(numbers.ravel().tolist())
    light = np.asarray((photo.grey / np.float32(255)) ** np.float32(2.2), np.float32)
    # OpenCV counts pixels from their centres.
    return {
        int(number): refined_corners(light, corner.reshape(4, 2).astype(np.float64) + 0.5)
        for number, corner in zip(numbers.ravel(), corners, strict=True)
        if int(number) in layout.tags and times[int(number)] == 1
    }


def check_sightings(sightings: Mapping[str, Sightings], layout: TagLayout, settings: AlignmentParameters) -> None:
    """Refuse photos that show too few tags, before the long work.

    Raises:
        UserError: fewer than ``least_tags`` are seen in ``least_views`` photos each.
    """
    counts = Counter(number for seen in sightings.values() for number in seen)
    good = sum(counts[number] >= settings.least_views for number in layout.tags)
    if good < settings.least_tags:
        raise UserError(
            f"{good} of the {len(layout.tags)} tags in tags.yaml are seen in {settings.least_views} photos or more, "
            f"{settings.least_tags} are needed; lay out at least four and keep them in view, or correct their family "
            "and numbers there."
        )


def _triangulate(projections: NDArray[np.float64], rays: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the point (3,) that ``projections`` (n, 3, 4) map nearest to ``rays`` (n, 2): linear, least squares."""
    rows = rays[:, :, None] * projections[:, 2:3] - projections[:, :2]
    homogeneous = np.linalg.svd(rows.reshape(-1, 4))[2][-1]
    return np.asarray(homogeneous[:3] / homogeneous[3])


def _offsets(
    projections: NDArray[np.float64], rays: NDArray[np.float64], focal: NDArray[np.float64], point: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return how far (n,) from its sighting the point is seen, pixels; infinite behind a camera."""
    local = projections[:, :, :3] @ point + projections[:, :, 3]
    front = local[:, 2] > 0
    offset = np.linalg.norm(local[:, :2] / np.where(front, local[:, 2], 1)[:, None] - rays, axis=1) * focal
    return np.asarray(np.where(front, offset, np.inf))


def locate(
    projections: NDArray[np.float64],
    rays: NDArray[np.float64],
    focal: NDArray[np.float64],
    tolerance: float,
    least_views: int,
) -> NDArray[np.float64] | None:
    """Return the point (3,) that most sightings agree on, None when fewer than ``least_views`` do.

    Every pair of sightings is tried (no draw of luck), then all inliers of the best pair together.

    Args:
        projections: (n, 3, 4) from the world to each camera.
        rays: (n, 2) undistorted sightings at depth 1.
        focal: (n,) focal lengths, pixels.
        tolerance: distance up to which a sighting agrees, pixels.
    """
    best: NDArray[np.bool_] = np.zeros(len(rays), bool)
    best_error = np.inf
    for i in range(len(rays)):
        for j in range(i):
            point = _triangulate(projections[[i, j]], rays[[i, j]])
            offsets = _offsets(projections, rays, focal, point)
            inside = offsets < tolerance
            error = float(offsets[inside].sum())
            if (inside.sum(), -error) > (best.sum(), -best_error):
                best, best_error = inside, error
    if best.sum() < max(least_views, 2):
        return None
    for _ in range(2):  # once more with what agrees with all of them
        point = _triangulate(projections[best], rays[best])
        best = _offsets(projections, rays, focal, point) < tolerance
        if best.sum() < max(least_views, 2):
            return None
    return point


def locate_corners(
    views: Sequence[SparseView], sightings: Mapping[str, Sightings], settings: AlignmentParameters
) -> dict[int, dict[int, NDArray[np.float64]]]:
    """Return per tag and corner (0 to 3) its position (3,) in the world frame of the sparse model.

    Args:
        sightings: per photo name what :func:`detect_tags` found.
    """
    numbers = sorted({number for seen in sightings.values() for number in seen})
    located: dict[int, dict[int, NDArray[np.float64]]] = {}
    for number in numbers:
        seeing = [view for view in views if number in sightings.get(view.photo.name, {})]
        if len(seeing) < settings.least_views:
            continue
        projections = np.array([view.T_camera_world[:3] for view in seeing])
        focal = np.array([view.camera.mean_focal_length() for view in seeing])
        rays = np.array([view.rays(sightings[view.photo.name][number]) for view in seeing])
        for corner in range(4):
            point = locate(projections, rays[:, corner], focal, settings.pixel_tolerance, settings.least_views)
            if point is not None:
                located.setdefault(number, {})[corner] = point
    return located
