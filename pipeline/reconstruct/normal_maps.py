"""Normal maps that a capture brings with it, made by any program."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pipeline.reconstruct.photos import Photo, shrunk
from pipeline.records.captures import Capture
from pipeline.records.errors import UserError

SHORTEST, LONGEST_IN_PICTURE = 0.5, 1.5  # of a vector that counts as a normal


def read_normals(path: Path) -> NDArray[np.float32]:
    """Return a normal map (h, w, 3), unit vectors in the camera frame, 0 where unknown.

    Vectors shorter than half a unit are unknown, and in a picture black and white too, which stand for no unit vector.

    Raises:
        UserError: the file is damaged or has another shape.
    """
    try:
        if path.suffix == ".npy":
            normals: Any = np.load(path, allow_pickle=False)
        else:
            with Image.open(path) as picture:
                normals = np.asarray(picture.convert("RGB"), np.float32) / 255 * 2 - 1
        normals = np.asarray(normals, np.float32)
    except (OSError, EOFError, SyntaxError, TypeError, ValueError, MemoryError, Image.DecompressionBombError) as error:
        raise UserError(f"{path} is no normal map ({error}); save it as .npy (h, w, 3) or as .png.") from error
    if normals.ndim != 3 or normals.shape[2] != 3 or not np.isfinite(normals).all():
        raise UserError(f"{path} has shape {normals.shape}; a normal map has three finite numbers per pixel.")
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    known = (length > SHORTEST) & (length < (np.inf if path.suffix == ".npy" else LONGEST_IN_PICTURE))
    return np.where(known, normals / np.maximum(length, 1e-6), 0).astype(np.float32)


def shrunk_normals(normals: NDArray[np.float32], times: int) -> NDArray[np.float32]:
    """Return a normal map (h, w, 3) shrunk like its photo; where half of a block or more is unknown, so is the mean."""
    means = shrunk(normals, times)
    length = np.linalg.norm(means, axis=2, keepdims=True)
    return np.where(length > SHORTEST, means / np.maximum(length, 1e-6), 0).astype(np.float32)


def normal_files(capture: Capture, photos: Sequence[Photo]) -> dict[str, Path]:
    """Return the normal maps of a capture by the names of their photos, all of them checked.

    Raises:
        UserError: a map is damaged or not as large as its photo.
    """
    files = {photo.name: capture.beside("normals", Path(photo.name)) for photo in photos}
    found = {name: path for name, path in files.items() if path is not None}
    sizes = {photo.name: photo.file_size for photo in photos}
    for name, path in found.items():
        height, width = read_normals(path).shape[:2]
        if (width, height) != sizes[name]:
            raise UserError(
                f"{path} has {width} x {height} pixels, its photo {sizes[name][0]} x {sizes[name][1]}; make it as "
                "large as the photo."
            )
    return found
