"""What is wrong with a capture, in sentences, before the long work starts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.reconstruct.camera_checks import check_lenses
from pipeline.reconstruct.detection import Seen, Sightings
from pipeline.reconstruct.photos import Photo
from pipeline.reconstruct.tag_cameras import (
    TagCameras,
    cameras_from_tags,
    guessed_lenses,
    lens_groups,
    solved_layout,
)
from pipeline.records.captures import Capture, KnownLength, Scene
from pipeline.records.errors import UserError
from pipeline.records.tag_layouts import TagLayout

FEW_PHOTOS = 12
BLURRED = 0.3  # of the capture's median sharpness
DARK, BRIGHT, MUCH = 8, 248, 0.3  # grey values, and the share of pixels beyond them
LEAST_SIGHTINGS = 3
LARGEST_MISFIT = 0.003  # m
AROUND = 0.01  # m around a box, that an object or its shadow may hide too
SAME_PICTURE = 3  # grey values, by which thumbnails of one picture differ at most
SIZES_TRIED = np.exp(np.linspace(np.log(0.5), np.log(2.0), 281))


def sharpness_of(grey: NDArray[np.uint8]) -> float:
    """Return how much of the contrast (h, w) is in the finest detail: variance of the Laplacian over its own."""
    scale = 960 / max(grey.shape)
    small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else grey
    return float(cv2.Laplacian(small, cv2.CV_32F).var() / max(float(small.var()), 1.0))


def _misfit(seen: Sightings, corners: Mapping[int, NDArray[np.float64]]) -> float:
    """Return how far (root mean square, m) flat corners are from where a homography sees them."""
    numbers = sorted(seen)
    pixels = np.concatenate([seen[number] for number in numbers])
    scene = np.concatenate([corners[number][:, :2] for number in numbers])
    homography, _ = cv2.findHomography(pixels, scene)
    if homography is None:
        return float("inf")
    mapped = np.concatenate([pixels, np.ones((len(pixels), 1))], axis=1) @ homography.T
    return float(np.sqrt(((mapped[:, :2] / mapped[:, 2:] - scene) ** 2).sum(axis=1).mean()))


def layout_sentences(sightings: Mapping[str, Sightings], layout: TagLayout) -> list[str]:
    """Return what the photos say against ``tags.yaml``: from photos that show two tags or more on one level."""
    truth = layout.corners()
    flat = {number for number, corners in truth.items() if np.ptp(corners[:, 2]) < 1e-6}
    level = {number: round(float(truth[number][0, 2]), 6) for number in flat}
    groups = []
    for seen in sightings.values():
        for height in set(level.values()):
            group = {number: corners for number, corners in seen.items() if level.get(number) == height}
            if len(group) >= 2:
                groups.append(group)
    if not groups:
        return []
    misfit = float(np.median([_misfit(group, truth) for group in groups]))
    if misfit < LARGEST_MISFIT:
        return []
    misfits = []
    for factor in SIZES_TRIED:
        sized = {n: c.mean(axis=0) + factor * (c - c.mean(axis=0)) for n, c in truth.items()}
        misfits.append(float(np.median([_misfit(group, sized) for group in groups])))
    best = int(np.argmin(misfits))
    if misfits[best] < LARGEST_MISFIT:
        return [
            f"tags.yaml says that tags are {1000 * layout.size:.1f} mm large, but with their positions only "
            f"{1000 * SIZES_TRIED[best] * layout.size:.0f} mm fit the photos; measure both again."
        ]
    return [
        f"The tags do not lie as tags.yaml says ({1000 * misfit:.0f} mm off); correct positions and yaws, or the "
        "convention (opencv or apriltag: turned by 180 degrees)."
    ]


def _under_objects(scene: Scene, layout: TagLayout) -> set[int]:
    """Return the tags that lie under an object, where no photo can show them whole."""
    found = set()
    for item in scene.objects.values():
        T = item.matrix(scene.support_plane)
        for number, corners in layout.corners().items():
            local = np.abs((corners - T[:3, 3]) @ T[:3, :3])[:, :2]
            if (local < np.array(item.box[:2]) / 2 + AROUND).all(axis=1).any():
                found.add(number)
    return found


def tag_sentences(scene: Scene, layout: TagLayout, seen: Mapping[str, Seen]) -> list[str]:
    """Return what is doubtful about the tags in the photos. Tags under an object are not missed."""
    counts = Counter(number for its in seen.values() for number in its.tags)
    found = []
    if layout.board is None:
        found += [
            f"Tag {number} is seen in {counts[number]} photos (where it is seen once); keep it in view of at least "
            f"{LEAST_SIGHTINGS}, or remove it from tags.yaml."
            for number in sorted(set(layout.poses()) - _under_objects(scene, layout))
            if counts[number] < LEAST_SIGHTINGS
        ]
    if sum(count >= LEAST_SIGHTINGS for count in counts.values()) < 4:
        found.append("Fewer than 4 tags are seen well; with 4 or more around the objects, sizes are right to 0.1 %.")
    repeated = Counter(number for its in seen.values() for number in its.repeated)
    found += [
        f"Tag {number} is seen several times in {count} photos and ignored there; every number may be in view once."
        for number, count in sorted(repeated.items())
    ]
    return found


def cameras_told(
    photos: Sequence[Photo], seen: Mapping[str, Seen], layout: TagLayout
) -> tuple[TagCameras | None, TagLayout]:
    """Return the cameras that the tags alone tell, None where they tell none, and the layout: as given, or as found."""
    known = {photo.size: photo.focal for photo in photos if photo.focal is not None}
    sightings = {name: its.tags for name, its in seen.items()}
    cameras = cameras_from_tags(photos, sightings, layout, guessed_lenses(lens_groups(photos)[0], known))
    if cameras is not None and layout.solved:
        layout, cameras = solved_layout(cameras, layout)
    return cameras, layout


def camera_sentences(photos: Sequence[Photo], cameras: TagCameras | None) -> tuple[list[str], str]:
    """Return what is doubtful about the cameras that the tags alone tell, and what they tell in short."""
    if cameras is None:
        return ["The tags tell no camera; keep two or more in view of every photo."], ""
    sizes, lens_of = lens_groups(photos)
    found = []
    poses = cameras.poses()
    unposed = [photo.name for photo in photos if photo.name not in poses]
    if len(unposed) > len(photos) / 2:
        found.append(f"Tags pose only {len(poses)} of {len(photos)} photos; keep two or more in view of every photo.")
    told = {photo.name: photo.focal for photo in photos if photo.focal is not None}
    try:
        check_lenses(cameras.bundle.lenses, sizes, told, {photo.name: photo.size for photo in photos})
    except UserError as error:
        text = str(error)
        found.append(text[0].upper() + text[1:])
    up = [float(np.degrees(np.arcsin(-T[2, 2]))) for T in poses.values()]
    focal = cameras.bundle.lenses[lens_of[cameras.names[0]]].focal
    said = (
        f"focal length {focal:.0f} pixels at the size worked with, cameras look down by {min(up):.0f} to {max(up):.0f}"
    )
    return found, f"{said} degrees, tags pose {len(poses)} of {len(photos)} photos"


def same_pictures(photos: Sequence[Photo]) -> list[tuple[str, str]]:
    """Return the pairs of photos that are the same picture, stored again perhaps."""
    small = {photo.name: cv2.resize(photo.grey, (32, 32), interpolation=cv2.INTER_AREA).astype(int) for photo in photos}
    return [(a, b) for a, b in combinations(sorted(small), 2) if np.abs(small[a] - small[b]).max() <= SAME_PICTURE]


def sentences(capture: Capture, photos: Sequence[Photo], seen: Mapping[str, Seen]) -> list[str]:
    """Return what is wrong or doubtful, one sentence each; empty when nothing is."""
    found = [f"{one} and {other} are the same picture; remove one." for one, other in same_pictures(photos)]
    if len(photos) < FEW_PHOTOS:
        found.append(f"There are only {len(photos)} photos; take at least {FEW_PHOTOS}, better 24, all around.")
    values = {photo.name: sharpness_of(photo.grey) for photo in photos}
    middle = float(np.median(list(values.values())))
    found += [
        f"{name} is blurred ({value / middle:.0%} of the usual sharpness); take it again or remove it."
        for name, value in values.items()
        if value < BLURRED * middle
    ]
    for photo in photos:
        dark, bright = (photo.grey < DARK).mean(), (photo.grey > BRIGHT).mean()
        if max(dark, bright) > MUCH:
            how = "black" if dark > bright else "white"
            found.append(f"{photo.name} is {max(dark, bright):.0%} {how}; correct the exposure and take it again.")
    if not isinstance(capture.tags, KnownLength):
        found += tag_sentences(capture.scene, capture.tags, seen)
        found += layout_sentences({name: its.tags for name, its in seen.items()}, capture.tags)
    sizes = {photo.size for photo in photos}
    if len(sizes) > 1:
        found.append(
            f"The photos have {len(sizes)} sizes; each size is taken for a camera of its own, so have several of each."
        )
    return found
