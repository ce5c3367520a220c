"""Cameras from tags alone: the lens and the pose of every photo that shows tags, and where unplaced tags lie."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.reconstruct.adjustment import Bundle, Freedom, adjust
from pipeline.reconstruct.detection import Sightings
from pipeline.reconstruct.lens import Lens
from pipeline.reconstruct.photos import Photo
from pipeline.records.poses import inverse_pose, position_quaternion
from pipeline.records.tag_layouts import TagLayout, TagPose

FOCALS = np.exp(np.linspace(np.log(0.45), np.log(3.5), 13))  # of the longer side, tried when nothing is known
LEAST_TAGS = 2  # in a photo: one alone fits two poses nearly as well
FITS = 3.0  # pixels: median distance of a photo's corners beyond which it is not posed by them
IN_PLANE = 0.006  # m: tags as near to a plane lie in it
NO_POINTS = (np.zeros((0, 2), np.int64), np.zeros((0, 2)))


@dataclass(frozen=True)
class TagCameras:
    """What the tags alone say."""

    names: tuple[str, ...]  # of the photos that were posed
    numbers: tuple[int, ...]  # of the tags
    bundle: Bundle

    def poses(self) -> dict[str, NDArray[np.float64]]:
        """Return ``T_camera_scene`` (4, 4) per photo."""
        return dict(zip(self.names, self.bundle.poses, strict=True))


def lens_groups(photos: Sequence[Photo]) -> tuple[list[tuple[int, int]], dict[str, int]]:
    """Return the sizes of the photos, and per photo the number of its size: one lens each."""
    sizes = sorted({photo.size for photo in photos})
    return sizes, {photo.name: sizes.index(photo.size) for photo in photos}


def pose_of(lens: Lens, places: NDArray[np.float64], pixels: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the pose (4, 4) in which a camera sees ``places`` (n, 3) at ``pixels`` (n, 2); None if there is none."""
    rays, middle = lens.rays(pixels), places.mean(axis=0)
    flat = np.linalg.svd(places - middle, compute_uv=False)[2] < 1e-3 * np.ptp(places, axis=0).max()
    method = cv2.SOLVEPNP_IPPE if flat else cv2.SOLVEPNP_SQPNP
    try:
        _, turns, shifts, _ = cv2.solvePnPGeneric(places - middle, rays, np.eye(3), None, flags=method)
    except cv2.error:
        return None
    best, least = None, np.inf
    for turn, shift in zip(turns, shifts, strict=True):
        T = np.eye(4)
        T[:3, :3] = cv2.Rodrigues(turn)[0]
        T[:3, 3] = shift.ravel() - T[:3, :3] @ middle
        local = places @ T[:3, :3].T + T[:3, 3]
        if not np.isfinite(T).all() or local[:, 2].min() <= 0:
            continue
        error = float(np.linalg.norm(local[:, :2] / local[:, 2:] - rays, axis=1).mean())
        if error < least:
            best, least = T, error
    return best


def _bundle(
    names: Sequence[str],
    poses: Mapping[str, NDArray[np.float64]],
    lenses: Sequence[Lens],
    lens_of: Mapping[str, int],
    sightings: Mapping[str, Sightings],
    tags: Mapping[int, NDArray[np.float64]],
    layout: TagLayout,
) -> Bundle:
    numbers = {number: at for at, number in enumerate(sorted(tags))}
    which, pixels = [], []
    for photo, name in enumerate(names):
        for number, corners in sightings[name].items():
            if number in numbers:
                which += [(photo, numbers[number], corner) for corner in range(4)]
                pixels.append(corners)
    return Bundle(
        tuple(lenses),
        np.array([lens_of[name] for name in names], np.int64),
        np.array([poses[name] for name in names]).reshape(-1, 4, 4),
        np.array([tags[number] for number in numbers]).reshape(-1, 4, 4),
        layout.square(),
        (np.array(which, np.int64).reshape(-1, 3), np.concatenate([np.zeros((0, 2)), *pixels])),
        np.zeros((0, 3)),
        NO_POINTS,
    )


def _typical(bundle: Bundle) -> float:
    errors = bundle.corner_errors()
    return float(np.mean(np.minimum(errors, 50.0))) if len(errors) else np.inf


def guessed_lenses(sizes: Sequence[tuple[int, int]], focals: Mapping[tuple[int, int], float]) -> list[list[Lens]]:
    """Return the sets of lenses to try, one lens per size of photos.

    Args:
        focals: focal lengths (pixels) that are known from EXIF data.
    """
    if all(size in focals for size in sizes):
        return [[Lens.guessed(*size, focals[size]) for size in sizes]]
    return [[Lens.guessed(*size, focals.get(size, factor * max(size))) for size in sizes] for factor in FOCALS]


def _placed_poses(
    names: Sequence[str],
    lenses: Sequence[Lens],
    lens_of: Mapping[str, int],
    sightings: Mapping[str, Sightings],
    corners: Mapping[int, NDArray[np.float64]],
    least_tags: int,
) -> dict[str, NDArray[np.float64]]:
    """Return the poses of the photos that show tags whose corners are known."""
    found = {}
    for name in names:
        seen = [number for number in sightings[name] if number in corners]
        if len(seen) < least_tags:
            continue
        places = np.concatenate([corners[number] for number in seen])
        T = pose_of(lenses[lens_of[name]], places, np.concatenate([sightings[name][number] for number in seen]))
        if T is not None:
            found[name] = T
    return found


def _by_distance(candidates: Sequence[NDArray[np.float64]], square: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the pose (4, 4) of several that is nearest to all others, by the corners of a tag there."""
    corners = np.array([square @ T[:3, :3].T + T[:3, 3] for T in candidates])
    apart = np.linalg.norm(corners[:, None] - corners[None], axis=-1).mean(axis=-1)
    return candidates[int(np.median(apart, axis=1).argmin())]


def _chained(
    names: Sequence[str],
    lenses: Sequence[Lens],
    lens_of: Mapping[str, int],
    sightings: Mapping[str, Sightings],
    layout: TagLayout,
) -> tuple[dict[str, NDArray[np.float64]], dict[int, NDArray[np.float64]]]:
    """Return poses of photos, and of tags in the frame of the tag seen most, from tag to tag over common photos."""
    square = layout.square()
    counts: dict[int, int] = {}
    for name in names:
        for number in sightings[name]:
            counts[number] = counts.get(number, 0) + 1
    first = max(sorted(counts), key=lambda number: counts[number])
    tags, poses = {first: np.eye(4)}, {}
    while True:
        corners = {number: square @ T[:3, :3].T + T[:3, 3] for number, T in tags.items()}
        poses = _placed_poses(names, lenses, lens_of, sightings, corners, 1)
        candidates: dict[int, list[NDArray[np.float64]]] = {}
        for name, T in poses.items():
            for number, pixels in sightings[name].items():
                if number not in tags:
                    local = pose_of(lenses[lens_of[name]], square, pixels)
                    if local is not None:
                        candidates.setdefault(number, []).append(inverse_pose(T) @ local)
        if not candidates:
            return poses, tags
        most = max(len(found) for found in candidates.values())
        for number, found in candidates.items():
            if len(found) >= min(most, 3):
                tags[number] = _by_distance(found, square)


def _scene_frame(tags: Mapping[int, NDArray[np.float64]], square: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``T_scene_tags`` (4, 4): the plane in which most tags lie is z = 0, their printed side up.

    The origin is the middle of the tag with the lowest number in that plane, x points to its right.
    """
    corners = {number: square @ T[:3, :3].T + T[:3, 3] for number, T in tags.items()}
    best: list[int] = []
    for T in tags.values():
        near = [n for n, c in corners.items() if np.abs((c - T[:3, 3]) @ T[:3, 2]).max() < 4 * IN_PLANE]
        best = near if len(near) > len(best) else best
    level = np.concatenate([corners[number] for number in best])
    up = np.linalg.svd(level - level.mean(axis=0))[2][2]
    up *= np.sign(sum(float(tags[number][:3, 2] @ up) for number in best))
    first = tags[min(best)]
    right = first[:3, 0] - (first[:3, 0] @ up) * up
    right /= np.linalg.norm(right)
    T = np.eye(4)
    T[:3, :3] = np.stack([right, np.cross(up, right), up])
    origin = first[:3, 3] + ((level.mean(axis=0) - first[:3, 3]) @ up) * up
    T[:3, 3] = -T[:3, :3] @ origin
    return T


def tags_in_plane(layout: TagLayout) -> tuple[list[int], float]:
    """Return the tags that lie in the plane z = 0, and how far (root mean square, m) their corners are from it."""
    corners = layout.corners()
    level = [number for number, places in corners.items() if np.abs(places[:, 2]).max() < IN_PLANE]
    off = np.concatenate([np.zeros(0), *(corners[number][:, 2] for number in level)])
    return level, float(np.sqrt((off**2).mean())) if len(off) else 0.0


def _adjusted(bundle: Bundle, freedom: Freedom) -> Bundle:
    """Adjust without the lens's distortion first, then with it."""
    focal_only = tuple(replace(lens, free=min(lens.free, 1)) for lens in bundle.lenses)
    found = adjust(replace(bundle, lenses=focal_only), freedom)
    lenses = tuple(replace(lens, free=own.free) for lens, own in zip(found.lenses, bundle.lenses, strict=True))
    return adjust(replace(found, lenses=lenses), freedom)


def cameras_from_tags(
    photos: Sequence[Photo],
    sightings: Mapping[str, Sightings],
    layout: TagLayout,
    guesses: Sequence[Sequence[Lens]],
    least_tags: int = LEAST_TAGS,
) -> TagCameras | None:
    """Return lenses and poses from tags alone, and the tags' places if they are not known; None if they cannot tell.

    Args:
        guesses: see :func:`guessed_lenses`; the set with which the tags fit best is kept.
        least_tags: that a photo must show to be posed.
    """
    _, lens_of = lens_groups(photos)
    names = [photo.name for photo in photos if len(sightings.get(photo.name, {})) >= 1]
    if not names:
        return None
    corners, best, least = layout.corners(), None, np.inf
    for lenses in guesses:
        if layout.solved:
            poses, tags = _chained(names, lenses, lens_of, sightings, layout)
        else:
            poses = _placed_poses(names, lenses, lens_of, sightings, corners, least_tags)
            tags = {number: pose.matrix() for number, pose in layout.poses().items()}
        shown = [name for name in names if name in poses]
        if len(shown) < 2:
            continue
        bundle = _bundle(shown, poses, lenses, lens_of, sightings, tags, layout)
        error = _typical(bundle)
        if error < least:
            best, least = (shown, tuple(sorted(tags)), bundle), error
    if best is None:
        return None
    shown, numbers, bundle = best
    bundle = _adjusted(bundle, Freedom(tags=layout.solved))
    return _without_misfits(TagCameras(tuple(shown), numbers, bundle))


def _without_misfits(found: TagCameras) -> TagCameras | None:
    """Leave out photos whose corners do not fit the pose that was found."""
    which, errors = found.bundle.corners[0], found.bundle.corner_errors()
    good = []
    for photo in range(len(found.names)):
        own = errors[which[:, 0] == photo]
        if len(own) and np.median(own) < FITS:
            good.append(photo)
    if len(good) < 2:
        return None
    number = {photo: at for at, photo in enumerate(good)}
    kept = np.isin(which[:, 0], good)
    moved = which[kept].copy()
    moved[:, 0] = [number[photo] for photo in moved[:, 0]]
    bundle = replace(
        found.bundle,
        lens_of=found.bundle.lens_of[good],
        poses=found.bundle.poses[good],
        corners=(moved, found.bundle.corners[1][kept]),
    )
    return TagCameras(tuple(found.names[photo] for photo in good), found.numbers, bundle)


def solved_layout(found: TagCameras, layout: TagLayout) -> tuple[TagLayout, TagCameras]:
    """Return the layout that the photos tell, and the cameras in its frame: z = 0 through most tags, z up."""
    tags = dict(zip(found.numbers, found.bundle.tags, strict=True))
    T = _scene_frame(tags, layout.square())
    placed = {}
    for number, pose in tags.items():
        position, quaternion = position_quaternion(T @ pose)
        placed[number] = TagPose(position=tuple(position), quaternion=tuple(quaternion))
    bundle = replace(found.bundle, poses=found.bundle.poses @ inverse_pose(T), tags=T @ found.bundle.tags)
    return layout.model_copy(update={"tags": placed}), TagCameras(found.names, found.numbers, bundle)
