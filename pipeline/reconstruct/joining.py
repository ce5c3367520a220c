"""Features joined to cameras: points between posed photos, poses of the others, all of it adjusted with the tags."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.reconstruct.adjustment import Bundle, Freedom, adjust
from pipeline.reconstruct.lens import MODELS, Lens

MOST_POINTS, CHOOSING_POINTS = 5000, 1500  # the longest tracks; fewer do to choose a lens
FAR_OFF = 6.0  # pixels: a feature seen as far from its point was matched wrongly
LEAST_ANGLE = 2.0  # degrees under which a point must be seen to be one
LEAST_RESECTED = 20  # points in a photo that pose it
KEPT_OUT = 4  # every so many-th photo is kept out to choose the lens
LEAST_TO_CHOOSE = 8  # photos
BETTER = 0.98  # of the plainer lens's error on photos kept out, that a richer one must reach


@dataclass(frozen=True)
class Tracks:
    """All features of all photos that are points: (m, 2) photo and point, (m, 2) pixels."""

    which: NDArray[np.int64]
    pixels: NDArray[np.float64]
    count: int


def _midpoints(
    centres: NDArray[np.float64], ahead: NDArray[np.float64], point: NDArray[np.int64], count: int
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the points (count, 3) nearest to their rays (n, 3), and which are well determined."""
    across = np.eye(3) - ahead[:, :, None] * ahead[:, None]
    A, b = np.zeros((count, 3, 3)), np.zeros((count, 3))
    np.add.at(A, point, across)
    np.add.at(b, point, (across @ centres[:, :, None])[..., 0])
    seen = np.bincount(point, minlength=count)
    # Two rays at an angle a leave 1 - cos a in the direction along both.
    steady = np.linalg.eigvalsh(A)[:, 0] > seen * (1 - np.cos(np.radians(LEAST_ANGLE))) / 2
    good = (seen >= 2) & steady
    found = np.zeros((count, 3))
    found[good] = np.linalg.solve(A[good], b[good][..., None])[..., 0]
    return found, good


def triangulated(
    tracks: Tracks, posed: NDArray[np.bool_], bundle: Bundle, far_off: float = FAR_OFF
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the points (count, 3), which are known, and which features (m,) agree with them.

    Args:
        posed: (photos,) whose poses in ``bundle`` hold.
        far_off: pixels from its point, from which on a feature is left out.
    """
    use = posed[tracks.which[:, 0]]
    R, t = bundle.poses[:, :3, :3], bundle.poses[:, :3, 3]
    centre = -(np.swapaxes(R, 1, 2) @ t[:, :, None])[..., 0]
    ahead = np.zeros((len(use), 3))
    for photo in np.flatnonzero(posed):
        own = tracks.which[:, 0] == photo
        rays = bundle.lenses[bundle.lens_of[photo]].rays(tracks.pixels[own])
        ahead[own] = np.concatenate([rays, np.ones((len(rays), 1))], axis=1) @ R[photo]
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-12)
    points, good = np.zeros((tracks.count, 3)), np.zeros(tracks.count, bool)
    for _ in range(4):
        photo, point = tracks.which[use].T
        points, good = _midpoints(centre[photo], ahead[use], point, tracks.count)
        errors = np.where(good[point, None], np.minimum(bundle.seen(photo, points[point]) - tracks.pixels[use], 1e6), 0)
        error = np.linalg.norm(errors, axis=1)
        worst = np.zeros(tracks.count)
        np.maximum.at(worst, point, error)
        bad = (error > far_off) & (error >= worst[point])
        if not bad.any():
            break
        use[np.flatnonzero(use)[bad]] = False
    use &= good[tracks.which[:, 1]]
    return points, good, use


def resected(
    bundle: Bundle, photo: int, places: NDArray[np.float64], pixels: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Return the pose (4, 4) of a photo that sees ``places`` (n, 3) at ``pixels`` (n, 2), some wrongly.

    None when too few of them agree.
    """
    if len(places) < LEAST_RESECTED:
        return None
    lens = bundle.lenses[bundle.lens_of[photo]]
    cv2.setRNGSeed(0)
    found, turn, shift, inside = cv2.solvePnPRansac(
        places, lens.rays(pixels), np.eye(3), None, iterationsCount=500, reprojectionError=FAR_OFF / lens.focal
    )
    if not found or inside is None or len(inside) < max(LEAST_RESECTED, len(places) // 3):
        return None
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = cv2.Rodrigues(turn)[0], shift.ravel()
    return T


def grown(bundle: Bundle, tracks: Tracks, posed: NDArray[np.bool_]) -> tuple[Bundle, NDArray[np.bool_]]:
    """Pose further photos by the points of those that are posed, until no more can be."""
    posed = posed.copy()
    while not posed.all():
        points, good, _ = triangulated(tracks, posed, bundle)
        added = False
        poses = bundle.poses.copy()
        for photo in np.flatnonzero(~posed):
            own = (tracks.which[:, 0] == photo) & good[tracks.which[:, 1]]
            T = resected(bundle, int(photo), points[tracks.which[own, 1]], tracks.pixels[own])
            if T is not None:
                poses[photo], posed[photo], added = T, True, True
        bundle = replace(bundle, poses=poses)
        if not added:
            break
    return bundle, posed


def with_points(bundle: Bundle, tracks: Tracks, posed: NDArray[np.bool_], most: int = MOST_POINTS) -> Bundle:
    """Return the bundle with the points of the longest tracks."""
    points, good, use = triangulated(tracks, posed, bundle)
    length = np.bincount(tracks.which[use, 1], minlength=tracks.count)
    order = np.argsort(-np.where(good, length, 0), kind="stable")[:most]
    order = order[length[order] >= 2]
    number = np.full(tracks.count, -1)
    number[order] = np.arange(len(order))
    kept = use & (number[tracks.which[:, 1]] >= 0)
    which = np.stack([tracks.which[kept, 0], number[tracks.which[kept, 1]]], axis=1)
    return replace(bundle, points=points[order], features=(which, tracks.pixels[kept]))


def _of_photos(bundle: Bundle, photos: NDArray[np.bool_]) -> Bundle:
    """Return the bundle with the observations of these photos (photos,) alone."""
    corner, feature = photos[bundle.corners[0][:, 0]], photos[bundle.features[0][:, 0]]
    return replace(
        bundle,
        corners=(bundle.corners[0][corner], bundle.corners[1][corner]),
        features=(bundle.features[0][feature], bundle.features[1][feature]),
    )


def _with_known_points(bundle: Bundle, known: NDArray[np.bool_]) -> Bundle:
    which, pixels = bundle.features
    kept = known[which[:, 1]]
    return replace(bundle, features=(which[kept], pixels[kept]))


def _freed(bundle: Bundle, model: str) -> tuple[Lens, ...]:
    return tuple(replace(lens, free=MODELS[model] if lens.free else 0) for lens in bundle.lenses)


def _error_kept_out(bundle: Bundle, posed: NDArray[np.bool_], placed: NDArray[np.float64], model: str) -> float:
    """Return how far, typically, photos that took no part in the adjustment are off, pixels; their poses are fitted."""
    out = posed & (np.cumsum(posed) % KEPT_OUT == 0)
    bundle = replace(bundle, lenses=_freed(bundle, model))
    learnt = _of_photos(bundle, posed & ~out)
    known = np.bincount(learnt.features[0][:, 1], minlength=len(bundle.points)) >= 2
    found = adjust(_with_known_points(learnt, known), Freedom(poses=posed & ~out, placed=placed))
    held = _with_known_points(_of_photos(replace(bundle, lenses=found.lenses, tags=found.tags), out), known)
    held = replace(held, points=found.points)
    told = adjust(held, Freedom(lenses=False, poses=out, tags=False, points=False))
    errors = np.concatenate([told.corner_errors(), told.feature_errors()])
    return float(np.sqrt((np.minimum(errors, FAR_OFF) ** 2).mean()))


@dataclass(frozen=True)
class Choice:
    """The lens model that the photos can tell, and the error of each that was tried on photos kept out, pixels."""

    model: str
    errors: dict[str, float]


def chosen_lens(
    bundle: Bundle, tracks: Tracks, posed: NDArray[np.bool_], placed: NDArray[np.float64], richest: str
) -> Choice:
    """Try lens models from the plainest on; a richer one is taken only where it lowers the error on photos kept out."""
    models = list(MODELS)[: list(MODELS).index(richest) + 1]
    if posed.sum() < LEAST_TO_CHOOSE or not any(lens.free for lens in bundle.lenses):
        return Choice(models[0], {})
    small = with_points(bundle, tracks, posed, CHOOSING_POINTS)
    errors = {model: _error_kept_out(small, posed, placed, model) for model in models}
    best = models[0]
    for model in models[1:]:
        best = model if errors[model] < BETTER * errors[best] else best
    return Choice(best, errors)


def steadied(bundle: Bundle, tracks: Tracks, posed: NDArray[np.bool_], placed: NDArray[np.float64]) -> Bundle:
    """Return the bundle after a first adjustment with few points and the plainest lens."""
    plain = replace(bundle, lenses=_freed(bundle, next(iter(MODELS))))
    return adjust(with_points(plain, tracks, posed, CHOOSING_POINTS), Freedom(poses=posed, placed=placed))


def adjusted_together(
    bundle: Bundle, tracks: Tracks, posed: NDArray[np.bool_], placed: NDArray[np.float64], choice: Choice
) -> Bundle:
    """Adjust lenses, poses, tags and points together, twice: with better cameras, more features find their points."""
    bundle = replace(bundle, lenses=_freed(bundle, choice.model))
    freedom = Freedom(poses=posed, placed=placed)
    for most in (CHOOSING_POINTS, MOST_POINTS):
        bundle = adjust(with_points(bundle, tracks, posed, most), freedom)
    return bundle


def feature_support(
    bundle: Bundle, tracks: Tracks, posed: NDArray[np.bool_], limit: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return per photo how many features it shares with points of the others, and the share seen within ``limit``."""
    points, good, _ = triangulated(tracks, posed, bundle, 2 * limit)
    photo, point = tracks.which.T
    known = good[point] & posed[photo]
    errors = np.linalg.norm(bundle.seen(photo[known], points[point[known]]) - tracks.pixels[known], axis=1)
    count = np.bincount(photo[known], minlength=len(posed))
    near = np.bincount(photo[known], errors < limit, minlength=len(posed))
    return count, near / np.maximum(count, 1)
