"""A camera at rest before a turning sheet: told from the photos, and the resting background left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.reconstruct.lens import Lens
from pipeline.reconstruct.photos import Photo
from pipeline.records.captures import Scene
from pipeline.records.tag_layouts import TagLayout

BORDER = 0.6  # of a tag's size: so far does the sheet go on around the outermost tags
AROUND_BOX = 0.01  # m around an object's box that counts as the object
WIDTH, BLOCK = 320, 8  # pixels: photos are compared at this size, in blocks
LEAST_CONTRAST = 5.0  # grey values: standard deviation of a block that shows something
SAME = 0.9  # correlation from which two blocks show the same
LEAST_BLOCKS = 20  # that must show something for a pair of photos to tell
RESTING = 0.5  # of them, from which on the background rests
LEAST_TURN = 4.0  # degrees between two photos against the sheet


def on_the_sheet(
    photos: Sequence[Photo],
    poses: Mapping[str, NDArray[np.float64]],
    lenses: Mapping[str, Lens],
    layout: TagLayout,
    scene: Scene,
) -> dict[str, NDArray[np.bool_]]:
    """Return per posed photo where (h, w) it shows the sheet of tags or what stands in an object's box."""
    corners = layout.corners()
    grown = [places.mean(axis=0) + (1 + 2 * BORDER) * (places - places.mean(axis=0)) for places in corners.values()]
    bodies = [np.concatenate(grown)]
    bodies += [item.corners(scene.support_plane, AROUND_BOX) for item in scene.objects.values()]
    found = {}
    for photo in photos:
        if photo.name not in poses:
            continue
        T, mask = poses[photo.name], np.zeros((photo.size[1], photo.size[0]), np.uint8)
        for body in bodies:
            local = body @ T[:3, :3].T + T[:3, 3]
            if local[:, 2].min() <= 0:
                continue
            pixels = lenses[photo.name].project(local)[0]
            hull = cv2.convexHull(np.clip(pixels, -1e4, 1e4).astype(np.float32))
            cv2.fillConvexPoly(mask, hull.round().astype(np.int32), 1)
        found[photo.name] = mask > 0
    return found


def _blocks(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the blocks (n, BLOCK * BLOCK) of a picture (h, w)."""
    rows, columns = pixels.shape[0] // BLOCK, pixels.shape[1] // BLOCK
    cut = pixels[: rows * BLOCK, : columns * BLOCK].reshape(rows, BLOCK, columns, BLOCK)
    return np.ascontiguousarray(cut.transpose(0, 2, 1, 3)).reshape(-1, BLOCK * BLOCK)


def _share_at_rest(one: NDArray[np.float32], other: NDArray[np.float32]) -> float | None:
    """Return the share of blocks (n, pixels) that two photos show alike, of those that show something.

    None when these are too few.
    """
    a, b = one - one.mean(axis=1, keepdims=True), other - other.mean(axis=1, keepdims=True)
    telling = (a.std(axis=1) > LEAST_CONTRAST) | (b.std(axis=1) > LEAST_CONTRAST)
    if telling.sum() < LEAST_BLOCKS:
        return None
    a, b = a[telling], b[telling]
    norms = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    return float(((a * b).sum(axis=1) / np.maximum(norms, 1e-6) > SAME).mean())


def background_rests(
    photos: Sequence[Photo], poses: Mapping[str, NDArray[np.float64]], sheets: Mapping[str, NDArray[np.bool_]]
) -> bool:
    """Return whether what is off the sheet stays where it is in the picture while the sheet turns.

    Two photos at which the camera stands differently to the sheet are compared block by block where neither shows the
    sheet; the middle one of all such pairs decides. An empty background tells nothing, and harms nothing.
    """
    shown = [photo for photo in photos if photo.name in poses]
    shares = []
    for one, other in pairwise(shown):
        turn = poses[one.name][:3, :3] @ poses[other.name][:3, :3].T
        angle = np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))
        if one.size != other.size or angle < LEAST_TURN:
            continue
        scale = WIDTH / max(one.size)
        size = (round(one.size[0] * scale), round(one.size[1] * scale))
        sheet = cv2.resize((sheets[one.name] | sheets[other.name]).astype(np.uint8), size, interpolation=cv2.INTER_AREA)
        off = _blocks(sheet.astype(np.float32)).max(axis=1) == 0
        pair = [
            _blocks(cv2.resize(photo.grey, size, interpolation=cv2.INTER_AREA).astype(np.float32))[off]
            for photo in (one, other)
        ]
        share = _share_at_rest(pair[0], pair[1])
        if share is not None:
            shares.append(share)
    return bool(shares) and float(np.median(shares)) > RESTING
