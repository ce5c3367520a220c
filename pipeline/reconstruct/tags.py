"""Tags of a capture: whether the photos show enough of them, and where their corners are in space."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.reconstruct.detection import Sightings
from pipeline.reconstruct.lens import Lens
from pipeline.reconstruct.photos import Photo
from pipeline.records.errors import UserError
from pipeline.records.parameters.reconstruct import AlignmentParameters
from pipeline.records.tag_layouts import TagLayout


class Posed(Protocol):
    """A photo with a pose, in any frame."""

    @property
    def photo(self) -> Photo:
        """The photo."""

    @property
    def lens(self) -> Lens:
        """Its lens."""

    @property
    def T_camera_scene(self) -> NDArray[np.float64]:
        """The pose (4, 4) of its camera."""


def check_sightings(sightings: Mapping[str, Sightings], layout: TagLayout, settings: AlignmentParameters) -> None:
    """Refuse photos that show too few tags, before the long work.

    Tags that no photo shows are no error: they may lie under an object.

    Raises:
        UserError: fewer than ``least_tags`` are seen in ``least_views`` photos each.
    """
    counts = Counter(number for seen in sightings.values() for number in seen)
    good = sum(counts[number] >= settings.least_views for number in layout.numbers())
    if good < settings.least_tags:
        raise UserError(
            f"{good} of the {len(layout.numbers())} tags in tags.yaml are seen in {settings.least_views} photos or "
            f"more, {settings.least_tags} are needed; lay out at least four and keep them in view, or correct their "
            "family and numbers there."
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
    views: Sequence[Posed], sightings: Mapping[str, Sightings], settings: AlignmentParameters
) -> dict[int, dict[int, NDArray[np.float64]]]:
    """Return per tag and corner (0 to 3) its position (3,) in the frame of the poses.

    Args:
        sightings: per photo name the tags in it.
    """
    numbers = sorted({number for seen in sightings.values() for number in seen})
    located: dict[int, dict[int, NDArray[np.float64]]] = {}
    for number in numbers:
        seeing = [view for view in views if number in sightings.get(view.photo.name, {})]
        if len(seeing) < settings.least_views:
            continue
        projections = np.array([view.T_camera_scene[:3] for view in seeing])
        focal = np.array([view.lens.focal for view in seeing])
        rays = np.array([view.lens.rays(sightings[view.photo.name][number]) for view in seeing])
        for corner in range(4):
            point = locate(projections, rays[:, corner], focal, settings.pixel_tolerance, settings.least_views)
            if point is not None:
                located.setdefault(number, {})[corner] = point
    return located
