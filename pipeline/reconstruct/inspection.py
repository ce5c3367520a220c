"""What is wrong with a capture, in sentences, before the long work starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.reconstruct.photos import Photo
from pipeline.reconstruct.tags import Sightings
from pipeline.records.captures import Capture, TagLayout

FEW_PHOTOS = 12
BLURRED = 0.3  # of the capture's median sharpness
DARK, BRIGHT, MUCH = 8, 248, 0.3  # grey values, and the share of pixels beyond them
LEAST_SIGHTINGS = 3
LARGEST_MISFIT = 0.003  # m
SIZES_TRIED = np.exp(np.linspace(np.log(0.5), np.log(2.0), 281))


def sharpness(photo: Photo) -> float:
    """Return how much of a photo's contrast is in its finest detail: variance of its Laplacian over its variance."""
    scale = 960 / max(photo.size)
    grey = cv2.resize(photo.grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else photo.grey
    return float(cv2.Laplacian(grey, cv2.CV_32F).var() / max(float(grey.var()), 1.0))


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


def sentences(capture: Capture, photos: Sequence[Photo], sightings: Mapping[str, Sightings]) -> list[str]:
    """Return what is wrong or doubtful, one sentence each; empty when nothing is."""
    found = []
    if len(photos) < FEW_PHOTOS:
        found.append(f"There are only {len(photos)} photos; take at least {FEW_PHOTOS}, better 24, all around.")
    values = {photo.name: sharpness(photo) for photo in photos}
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
    counts = {number: sum(number in seen for seen in sightings.values()) for number in capture.tags.tags}
    found += [
        f"Tag {number} is seen in {count} photos (where it is seen once); keep it in view of at least "
        f"{LEAST_SIGHTINGS}, or remove it from tags.yaml."
        for number, count in counts.items()
        if count < LEAST_SIGHTINGS
    ]
    if sum(count >= LEAST_SIGHTINGS for count in counts.values()) < 4:
        found.append("Fewer than 4 tags are seen well; with 4 or more, spread over 30 cm, sizes are right to 0.1 %.")
    sizes = {photo.size for photo in photos}
    if len(sizes) > 1:
        found.append(
            f"The photos have {len(sizes)} sizes; each size is taken for a camera of its own, so have several of each."
        )
    return found + layout_sentences(sightings, capture.tags)
