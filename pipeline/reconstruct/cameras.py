"""The cameras of a capture in the scene frame, metric: from tags where photos show them, from features elsewhere.

Without tags, features alone pose the photos, and a known length with the plane beneath gives scale and frame.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
from numpy.typing import NDArray

from pipeline.reconstruct.adjustment import Bundle, Freedom, focal_spread
from pipeline.reconstruct.alignment import Alignment, align
from pipeline.reconstruct.camera_checks import check_lenses, check_scale, wrong_photos
from pipeline.reconstruct.detection import Seen, Sightings
from pipeline.reconstruct.features import Matches, extract_and_match, tracks
from pipeline.reconstruct.joining import (
    Choice,
    Tracks,
    adjusted_together,
    chosen_lens,
    grown,
    steadied,
    with_points,
)
from pipeline.reconstruct.known_length import marks_as_worked_with, told_by_length
from pipeline.reconstruct.lens import Lens
from pipeline.reconstruct.photos import Photo
from pipeline.reconstruct.sparse import mapped
from pipeline.reconstruct.tag_cameras import (
    NO_POINTS,
    TagCameras,
    cameras_from_tags,
    guessed_lenses,
    lens_groups,
    solved_layout,
    tags_in_plane,
)
from pipeline.reconstruct.tags import locate_corners
from pipeline.reconstruct.turntable import background_rests, on_the_sheet
from pipeline.records.captures import Intrinsics, KnownLength, Scene
from pipeline.records.errors import UserError
from pipeline.records.parameters.reconstruct import AlignmentParameters, ReconstructParameters, SparseParameters
from pipeline.records.tag_layouts import TagLayout

UNADJUSTED = 5.0  # times the usual distances in pixels may be off before the first adjustment
MATCHED = 4.0  # pixels, within which a feature is one of its point
LEAST_BY_TAGS = 0.5  # of the photos that tags must pose; else features find all poses first


@dataclass(frozen=True)
class PosedPhoto:
    """One photo whose pose was found."""

    photo: Photo
    lens: Lens
    T_camera_scene: NDArray[np.float64]  # (4, 4), m


@dataclass(frozen=True)
class Cameras:
    """What was found, and how well it fits."""

    views: tuple[PosedPhoto, ...]  # in the order of the photos' names
    alignment: Alignment | None  # of the tags; None without them
    points: NDArray[np.float64]  # (n, 3), scene frame
    reprojection: float  # mean over the features, pixels
    photos: int  # how many there were
    dropped: dict[str, str]  # per photo that is not used, why
    facts: dict[str, Any] = field(default_factory=dict)  # of lens, scale and places, for metrics.json


def _from_features(
    folder: Path, photos: Sequence[Photo], guesses: Sequence[Lens], settings: ReconstructParameters, seed: int
) -> tuple[dict[str, NDArray[np.float64]], list[Lens]]:
    """Return poses in a frame and a scale of their own, and lenses, by COLMAP's mapping."""
    calibrated = not any(lens.free for lens in guesses)
    found = mapped(folder, photos, settings.sparse, calibrated, seed)
    return found.poses, list(guesses) if calibrated else [
        found.lenses.get((own.width, own.height), own) for own in guesses
    ]


def _posed_photos(
    photos: Sequence[Photo],
    poses: Mapping[str, NDArray[np.float64]],
    lenses: Sequence[Lens],
    lens_of: Mapping[str, int],
) -> tuple[PosedPhoto, ...]:
    return tuple(
        PosedPhoto(photo, lenses[lens_of[photo.name]], poses[photo.name]) for photo in photos if photo.name in poses
    )


def _whole(
    photos: Sequence[Photo],
    poses: Mapping[str, NDArray[np.float64]],
    lenses: Sequence[Lens],
    lens_of: Mapping[str, int],
    sightings: Mapping[str, Sightings],
    layout: TagLayout | None,
) -> tuple[Bundle, NDArray[np.bool_], NDArray[np.float64]]:
    """Return the bundle of all photos without points, which are posed, and where the tags' corners should be."""
    placed, tags = (layout.corners(), layout.poses()) if layout else ({}, {})
    numbers = {number: at for at, number in enumerate(sorted(placed))}
    which, pixels = [], []
    for at, photo in enumerate(photos):
        for number, corners in sightings.get(photo.name, {}).items():
            if number in numbers:
                which += [(at, numbers[number], corner) for corner in range(4)]
                pixels.append(corners)
    bundle = Bundle(
        tuple(lenses),
        np.array([lens_of[photo.name] for photo in photos], np.int64),
        np.array([poses.get(photo.name, np.eye(4)) for photo in photos]),
        np.array([tags[number].matrix() for number in numbers]).reshape(-1, 4, 4),
        layout.square() if layout else np.zeros((4, 3)),
        (np.array(which, np.int64).reshape(-1, 3), np.concatenate([np.zeros((0, 2)), *pixels])),
        np.zeros((0, 3)),
        NO_POINTS,
    )
    posed = np.array([photo.name in poses for photo in photos])
    return bundle, posed, np.array([placed[number] for number in numbers]).reshape(-1, 4, 3)


def _all_posed(bundle: Bundle, posed: NDArray[np.bool_]) -> Bundle:
    """Return the bundle without the corners that photos without a pose show."""
    kept = posed[bundle.corners[0][:, 0]]
    return replace(bundle, corners=(bundle.corners[0][kept], bundle.corners[1][kept]))


def _tracks(matches: Matches, photos: Sequence[Photo]) -> Tracks:
    return Tracks(*tracks(matches, [photo.name for photo in photos]))


def _check_count(kept: int, photos: int, dropped: Mapping[str, str], settings: SparseParameters) -> None:
    if kept < max(3, settings.least_registered * photos):
        said = "; ".join(f"{name} {reason}" for name, reason in list(dropped.items())[:3])
        raise UserError(
            f"only {kept} of {photos} photos fit together ({said}); take more of them with smaller steps between, "
            "sharp, with the tags in view, and with something textured (a printed cloth) on the table."
        )


def _with_reasons(
    bundle: Bundle, found: Tracks, posed: NDArray[np.bool_], photos: Sequence[Photo], slack: float
) -> tuple[NDArray[np.bool_], dict[str, str]]:
    """Return which photos are kept, and why the others are not; ``slack`` as in :func:`wrong_photos`."""
    dropped = {
        photo.name: "shares too little with the others to be placed"
        for photo, its in zip(photos, posed, strict=True)
        if not its
    }
    wrong = wrong_photos(bundle, found, posed, slack)
    kept = posed.copy()
    for at, reason in wrong.items():
        kept[at], dropped[photos[at].name] = False, reason
    return kept, dropped


def _joined(
    bundle: Bundle,
    found: Tracks,
    posed: NDArray[np.bool_],
    placed: NDArray[np.float64],
    photos: Sequence[Photo],
    settings: SparseParameters,
) -> tuple[Bundle, NDArray[np.bool_], Choice, dict[str, str]]:
    """Adjust everything together; leave out the photos that do not fit the rest, and adjust again without them."""
    bundle, posed = grown(bundle, found, posed)
    kept, dropped = _with_reasons(bundle, found, posed, photos, UNADJUSTED)
    _check_count(int(kept.sum()), len(photos), dropped, settings)
    bundle = steadied(_all_posed(bundle, kept), found, kept, placed)
    choice = chosen_lens(_all_posed(bundle, kept), found, kept, placed, settings.camera_model)
    while True:
        bundle = adjusted_together(_all_posed(bundle, kept), found, kept, placed, choice)
        again, more = _with_reasons(bundle, found, kept, photos, 1.0)
        if again.sum() == kept.sum():
            return bundle, kept, choice, dropped
        kept, dropped = again, {**more, **dropped}
        _check_count(int(kept.sum()), len(photos), dropped, settings)


def _facts(
    bundle: Bundle, kept: NDArray[np.bool_], placed: NDArray[np.float64], choice: Choice, exif: Mapping[str, float]
) -> dict[str, Any]:
    """Return what metrics.json says of the cameras."""
    spread = focal_spread(bundle, Freedom(poses=kept, placed=placed))
    centres = np.array([-T[:3, :3].T @ T[:3, 3] for T in bundle.poses[kept]])
    distance = np.linalg.norm(centres - bundle.middle(), axis=1)
    largest = max(bundle.lenses, key=lambda lens: lens.width)
    return {
        "lens": choice.model if largest.free else "calibrated",
        "lens_errors_px": choice.errors,
        "focal_px": largest.focal,
        "focal_px_spread": float(spread[bundle.lenses.index(largest)]),
        "focal_px_exif": float(np.median(list(exif.values()))) if exif else None,
        "distortion": largest.values[1:].tolist(),
        "corner_px": float(np.median(bundle.corner_errors())) if len(bundle.corners[1]) else None,
        "camera_m_nearest": float(distance.min()),
        "camera_m_farthest": float(distance.max()),
    }


def _kept_poses(photos: Sequence[Photo], bundle: Bundle, kept: NDArray[np.bool_]) -> dict[str, NDArray[np.float64]]:
    return {photo.name: T for photo, T, its in zip(photos, bundle.poses, kept, strict=True) if its}


def _reprojection(bundle: Bundle) -> float:
    """Return how far features are from where their points are seen, pixels, without those matched wrongly."""
    errors = bundle.feature_errors()
    return float(errors[errors < MATCHED].mean())


@dataclass(frozen=True)
class _Start:
    """Cameras and layout from tags alone, and photos whose resting background is masked."""

    tags: TagCameras | None
    layout: TagLayout
    photos: tuple[Photo, ...]
    turntable: bool


def _start(
    photos: Sequence[Photo],
    sightings: Mapping[str, Sightings],
    layout: TagLayout,
    scene: Scene,
    guesses: Sequence[Sequence[Lens]],
    alignment: AlignmentParameters,
) -> _Start:
    found = cameras_from_tags(photos, sightings, layout, guesses, min(alignment.least_tags, 2))
    if layout.solved:
        if found is None or len(found.names) < LEAST_BY_TAGS * len(photos):
            raise UserError(
                "tags.yaml leaves it to the photos where the tags lie, but too few photos show several tags at once; "
                "lay the tags closer together, or measure their places."
            )
        layout, found = solved_layout(found, layout)
    if found is None:
        return _Start(None, layout, tuple(photos), False)
    poses, (_, lens_of) = found.poses(), lens_groups(photos)
    lenses = {photo.name: found.bundle.lenses[lens_of[photo.name]] for photo in photos}
    sheets = on_the_sheet(photos, poses, lenses, layout, scene)
    if not background_rests(photos, poses, sheets):
        return _Start(found, layout, tuple(photos), False)
    masked = tuple(
        replace(photo, usable=sheets[photo.name] & (True if photo.usable is None else photo.usable))
        for photo in photos
        if photo.name in sheets
    )
    return _Start(found, layout, masked, True)


def _guesses(photos: Sequence[Photo], intrinsics: Intrinsics | None) -> list[list[Lens]]:
    """Return the sets of lenses to begin with, one lens per size of photos.

    Raises:
        UserError: ``intrinsics.yaml`` is for photos of another size.
    """
    if intrinsics is not None:
        intrinsics.check_sizes({photo.name: photo.file_size for photo in photos})
        return [[Lens.calibrated(intrinsics.shrunk(photos[0].times))]]  # all have one size
    return guessed_lenses(
        lens_groups(photos)[0], {photo.size: photo.focal for photo in photos if photo.focal is not None}
    )


def find_cameras(
    photos: Sequence[Photo],
    seen: Mapping[str, Seen],
    layout: TagLayout,
    scene: Scene,
    intrinsics: Intrinsics | None,
    settings: ReconstructParameters,
    seed: int,
) -> Cameras:
    """Return the cameras of all photos that fit together.

    Args:
        seen: per photo name the tags in it.

    Raises:
        UserError: too few photos or tags, tags that are not as ``tags.yaml`` says, or cameras that cannot be.
    """
    sizes, lens_of = lens_groups(photos)
    exif = {photo.name: photo.focal for photo in photos if photo.focal is not None}
    guesses = _guesses(photos, intrinsics)
    sightings = {name: its.tags for name, its in seen.items()}
    start = _start(photos, sightings, layout, scene, guesses, settings.alignment)
    given, used, layout = layout, start.photos, start.layout
    trusted = start.tags if start.tags and len(start.tags.names) >= LEAST_BY_TAGS * len(photos) else None
    lenses = list(trusted.bundle.lenses) if trusted else list(guesses[0])
    poses = trusted.poses() if trusted else {}
    pycolmap.logging.minloglevel = 2
    pycolmap.set_random_seed(seed)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        told = dict(zip(sizes, lenses, strict=True)) if trusted or len(guesses) == 1 else {}
        matches = extract_and_match(folder, used, told, poses, settings.sparse, seed)
        if trusted is None:
            mapped_poses, lenses = _from_features(folder, used, lenses, settings, seed)
            views = _posed_photos(used, mapped_poses, lenses, lens_of)
            first = align(locate_corners(views, sightings, settings.alignment), layout, settings.alignment)
            poses = {name: first.similarity.camera(T) for name, T in mapped_poses.items()}
    bundle, posed, placed = _whole(used, poses, lenses, lens_of, sightings, layout)
    found = _tracks(matches, used)
    bundle, kept, choice, dropped = _joined(bundle, found, posed, placed, used, settings.sparse)
    dropped |= {name: "shows too few tags" for name in lens_of if name not in {photo.name for photo in used}}
    check_lenses(bundle.lenses, sizes, exif, {photo.name: photo.size for photo in photos})
    views = _posed_photos(used, _kept_poses(used, bundle, kept), bundle.lenses, lens_of)
    located = locate_corners(views, sightings, settings.alignment)
    alignment = align(located, layout, settings.alignment)
    facts = {
        "cameras_from": "tags" if trusted else "features",
        "turntable": start.turntable,
        "tags_placed": "photos" if given.solved else "tags.yaml",
        "tags_off_plane_mm": 1000 * tags_in_plane(layout)[1],
        **_facts(bundle, kept, placed, choice, exif),
        **check_scale(located, layout),
    }
    return Cameras(views, alignment, bundle.points, _reprojection(bundle), len(photos), dropped, facts)


def find_cameras_by_length(
    photos: Sequence[Photo],
    scale: KnownLength,
    intrinsics: Intrinsics | None,
    settings: ReconstructParameters,
    seed: int,
) -> Cameras:
    """Return the cameras of all photos that fit together, from features, a known length and the plane beneath.

    Raises:
        UserError: too few photos, marks that do not fit together, no plane, or cameras that cannot be.
    """
    sizes, lens_of = lens_groups(photos)
    exif = {photo.name: photo.focal for photo in photos if photo.focal is not None}
    marks = marks_as_worked_with(scale, photos)
    guesses = _guesses(photos, intrinsics)
    pycolmap.logging.minloglevel = 2
    pycolmap.set_random_seed(seed)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        told = dict(zip(sizes, guesses[0], strict=True)) if len(guesses) == 1 else {}
        found = _tracks(extract_and_match(folder, photos, told, {}, settings.sparse, seed), photos)
        poses, lenses = _from_features(folder, photos, guesses[0], settings, seed)
    bundle, posed, _ = _whole(photos, poses, lenses, lens_of, {}, None)
    points = with_points(bundle, found, posed).points
    first = told_by_length(scale, marks, _posed_photos(photos, poses, lenses, lens_of), points, seed)
    metric = {name: first.similarity.camera(T) for name, T in poses.items()}
    bundle, posed, placed = _whole(photos, metric, lenses, lens_of, {}, None)
    bundle, kept, choice, dropped = _joined(bundle, found, posed, placed, photos, settings.sparse)
    check_lenses(bundle.lenses, sizes, exif, {photo.name: photo.size for photo in photos})
    # The adjustment moved the cameras, and nothing held the frame.
    poses = _kept_poses(photos, bundle, kept)
    last = told_by_length(scale, marks, _posed_photos(photos, poses, bundle.lenses, lens_of), bundle.points, seed)
    bundle = replace(
        bundle,
        poses=np.array([last.similarity.camera(T) for T in bundle.poses]),
        points=last.similarity.points(bundle.points),
    )
    views = _posed_photos(photos, _kept_poses(photos, bundle, kept), bundle.lenses, lens_of)
    facts = {"cameras_from": "features", **_facts(bundle, kept, placed, choice, exif), **last.facts}
    return Cameras(views, None, bundle.points, _reprojection(bundle), len(photos), dropped, facts)
