"""Whether cameras can be as they were found: lenses, places, scale. What cannot be is refused, never passed on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.reconstruct.adjustment import Bundle
from pipeline.reconstruct.joining import Tracks, feature_support
from pipeline.reconstruct.lens import Lens
from pipeline.records.errors import UserError
from pipeline.records.tag_layouts import TagLayout

SHORTEST, LONGEST = 0.35, 6.0  # focal lengths of real cameras, in longer sides of the picture
LARGEST_EXIF = 0.15  # relative difference to the focal length that EXIF data tell
FITS = 3.0  # pixels, within which a feature is where its point is seen
LEAST_FEATURES, LEAST_FITTING = 20, 0.5  # in a photo: so many tell, and such a share must fit
LARGEST_CORNER = 4.0  # pixels: median of a photo's tag corners
FARTHER, NEARER = 4.0, 0.2  # of the median distance to the scene, beyond which a camera stands alone
LARGEST_SCALE = 0.03  # relative difference of a tag's size from the others', of well-seen tags
LEAST_SEEN = 4  # corners located


def _monotone(lens: Lens) -> bool:
    """Return whether rays farther from the axis are seen farther out, up to the corner of the picture."""
    reach = np.hypot(lens.width, lens.height) / 2 / lens.focal
    _, k1, k2 = lens.values[:3]
    r = np.linspace(0, 1.05 * reach, 100)
    return bool((1 + 3 * k1 * r**2 + 5 * k2 * r**4 > 0).all())


def check_lenses(
    lenses: Sequence[Lens],
    sizes: Sequence[tuple[int, int]],
    exif: Mapping[str, float],
    photo_sizes: Mapping[str, tuple[int, int]],
) -> None:
    """Refuse lenses that no camera has, or that contradict the photos' EXIF data.

    Args:
        exif: per photo the focal length (pixels) that its EXIF data tell.

    Raises:
        UserError: the lens cannot be.
    """
    for lens, size in zip(lenses, sizes, strict=True):
        part = lens.focal / max(lens.width, lens.height)
        if not SHORTEST < part < LONGEST or not _monotone(lens):
            raise UserError(
                f"the photos of {size[0]} x {size[1]} pixels lead to an impossible camera (focal length "
                f"{lens.focal:.0f} pixels, distortion {lens.values[1]:.2f}); take photos from more heights and "
                "directions, or give intrinsics.yaml."
            )
        told = [focal for name, focal in exif.items() if photo_sizes[name] == size]
        if told and lens.free and abs(lens.focal / np.median(told) - 1) > LARGEST_EXIF:
            raise UserError(
                f"the photos of {size[0]} x {size[1]} pixels lead to a focal length of {lens.focal:.0f} pixels, but "
                f"their EXIF data say {np.median(told):.0f}; use them as the camera stored them (not cropped, one "
                "lens, no zoom), check the size of the tags, or give intrinsics.yaml."
            )


def wrong_photos(bundle: Bundle, tracks: Tracks, posed: NDArray[np.bool_], slack: float = 1.0) -> dict[int, str]:
    """Return per photo that does not fit the others why not, in words that follow its name.

    Args:
        slack: by which distances in pixels may be larger, before cameras were adjusted.
    """
    found = {}
    count, share = feature_support(bundle, tracks, posed, slack * FITS)
    which, errors = bundle.corners[0], bundle.corner_errors()
    centres = -(np.swapaxes(bundle.poses[:, :3, :3], 1, 2) @ bundle.poses[:, :3, 3, None])[..., 0]
    distance = np.linalg.norm(centres - bundle.middle(), axis=1)
    usual = float(np.median(distance[posed]))
    for photo in np.flatnonzero(posed):
        own = which[:, 0] == photo
        tags = np.unique(which[own, 1])
        behind = [tag for tag in tags if (centres[photo] - bundle.tags[tag, :3, 3]) @ bundle.tags[tag, :3, 2] <= 0]
        if not NEARER * usual < distance[photo] < FARTHER * usual:
            found[int(photo)] = f"would be {distance[photo]:.2f} m away, the others {usual:.2f} m"
        elif behind:
            found[int(photo)] = "would look at the tags from behind"
        elif own.any() and np.median(errors[own]) > slack * LARGEST_CORNER:
            found[int(photo)] = f"shows the tags {np.median(errors[own]):.0f} pixels off"
        elif count[photo] >= LEAST_FEATURES and share[photo] < LEAST_FITTING:
            found[int(photo)] = f"fits the others in only {share[photo]:.0%} of what it shares with them"
        elif count[photo] < LEAST_FEATURES and len(tags) < 2:
            found[int(photo)] = "shares too little with the others to be placed"
    return found


def check_scale(located: Mapping[int, Mapping[int, NDArray[np.float64]]], layout: TagLayout) -> dict[str, float | None]:
    """Return how large the tags are, measured in the scene, over what ``tags.yaml`` says: smallest and largest.

    Args:
        located: per tag and corner its position (3,), scene frame.

    Raises:
        UserError: a tag has another scale than the rest.
    """
    ratios = {}
    for number, corners in located.items():
        if len(corners) >= LEAST_SEEN:
            square = np.array([corners[k] for k in range(4)])
            ratios[number] = float(np.linalg.norm(square - np.roll(square, -1, axis=0), axis=1).mean() / layout.size)
    if not ratios:
        return {"tag_scale_smallest": None, "tag_scale_largest": None}
    usual = float(np.median(list(ratios.values())))
    worst = max(ratios, key=lambda number: abs(ratios[number] / usual - 1))
    if abs(ratios[worst] / usual - 1) > LARGEST_SCALE:
        raise UserError(
            f"tag {worst} is {100 * abs(ratios[worst] / usual - 1):.0f} % "
            f"{'larger' if ratios[worst] > usual else 'smaller'} than the others; all tags must have the size that "
            "tags.yaml states, so print it again or remove it there."
        )
    return {"tag_scale_smallest": min(ratios.values()), "tag_scale_largest": max(ratios.values())}
