"""The photos of a capture as pixels, upright."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps, UnidentifiedImageError

from pipeline.reconstruct.lens import focal_of_film
from pipeline.records.captures import Capture
from pipeline.records.errors import UserError

SMALLEST_SIDE = 64  # pixels
HEIC_BRANDS = {b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1"}  # in bytes 8 to 12
EXIF_FOLDER, FOCAL_AS_FILM = 0x8769, 0xA405  # EXIF's own folder, and in it the focal length as on 35 mm film


@dataclass(frozen=True)
class Photo:
    """One photo, EXIF orientation applied, shrunk where it is larger than needed."""

    name: str  # stem of the file
    grey: NDArray[np.uint8]  # (height, width)
    usable: NDArray[np.bool_] | None  # (height, width), from masks/; None: everything
    file_size: tuple[int, int]  # width and height of the file, pixels
    times: int = 1  # by which it was shrunk
    focal: float | None = None  # focal length by its EXIF data, pixels of the shrunk photo; None: not told

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self.grey.shape[1], self.grey.shape[0]


def shrunk(pixels: NDArray[Any], times: int) -> NDArray[np.float32]:
    """Return the means (h // times, w // times, ...) of square blocks; pixels left over at the far edges are cut off.

    A point at (x, y), pixel centres at .5, comes to (x / times, y / times) exactly.
    """
    height, width = pixels.shape[0] // times, pixels.shape[1] // times
    blocks = pixels[: height * times, : width * times].reshape(height, times, width, times, *pixels.shape[2:])
    return np.asarray(blocks.mean(axis=(1, 3), dtype=np.float32))


def _opened(path: Path) -> Image.Image:
    """Open a photo; HEIC is known by its content, and comes upright, with no orientation left in its EXIF data.

    Raises:
        UserError: the photo is HEIC, and the package that reads it is not installed.
        OSError: it cannot be opened.
    """
    if _is_heic(path):
        try:
            from pi_heif import register_heif_opener
        except ImportError as error:
            raise UserError(
                f"{path} is a HEIC photo; install what reads it (pip install -c constraints.txt -e '.[heic]'), or "
                "convert it to JPEG."
            ) from error
        register_heif_opener()
    return Image.open(path)


def _is_heic(path: Path) -> bool:
    with open(path, "rb") as file:
        head = file.read(12)
    return head[4:8] == b"ftyp" and head[8:] in HEIC_BRANDS


def _read(path: Path, mode: Literal["L", "RGB"]) -> NDArray[np.uint8]:
    """Return the pixels of a photo, turned as its EXIF data say: (h, w), or (h, w, 3) in colour.

    Raises:
        UserError: the file is no readable picture, or a very small one.
    """
    try:
        with _opened(path) as picture:
            upright = ImageOps.exif_transpose(picture)
            if upright.mode.startswith("I"):  # 16 bits, which Pillow would cut off at 255
                upright = Image.fromarray(np.asarray(np.asarray(upright) // 257, np.uint8))
            pixels = np.asarray(upright.convert(mode))
    except UnidentifiedImageError as error:
        if _is_heic(path):
            raise UserError(f"{path} is damaged; copy it from the camera again, or remove it.") from error
        raise UserError(
            f"{path} is no JPEG, PNG or HEIC picture whatever its name says; convert it to JPEG or remove it."
        ) from error
    except Image.DecompressionBombError as error:
        raise UserError(f"{path} is too large ({error}); shrink all photos alike.") from error
    except (OSError, RuntimeError, SyntaxError, ValueError) as error:
        raise UserError(f"{path} is damaged ({error}); copy it from the camera again, or remove it.") from error
    if min(pixels.shape[:2]) < SMALLEST_SIDE:
        raise UserError(
            f"{path} has only {pixels.shape[1]} x {pixels.shape[0]} pixels; use the photo itself, no preview."
        )
    return pixels


def read_grey(path: Path) -> NDArray[np.uint8]:
    """Return the brightness (h, w) of a photo, upright.

    Raises:
        UserError: the file is no readable picture, or a very small one.
    """
    return _read(path, "L")


def read_colours(path: Path) -> NDArray[np.uint8]:
    """Return the colours (h, w, 3) of a photo, upright; raises as :func:`read_grey`."""
    return _read(path, "RGB")


def exif_focal(path: Path) -> float | None:
    """Return the focal length (pixels of the file) that a photo's EXIF data tell, None where they tell none."""
    try:
        with _opened(path) as picture:
            size, told = picture.size, picture.getexif().get_ifd(EXIF_FOLDER).get(FOCAL_AS_FILM)
        return focal_of_film(float(told), *size) if told else None
    except (OSError, RuntimeError, SyntaxError, ValueError, TypeError, ZeroDivisionError):
        return None  # damaged metadata tell nothing; the pixels are read on their own


def read_photos(capture: Capture, largest_side: int) -> list[Photo]:
    """Read the photos of a capture in the order of their names.

    Args:
        largest_side: pixels; larger photos are shrunk by the smallest whole number that makes them fit.

    Raises:
        UserError: a photo or mask is damaged, or there are fewer than three photos.
    """
    photos = []
    for path in capture.images:
        grey = read_grey(path)
        mask = capture.beside("masks", path)
        usable = None
        if mask is not None:
            usable = read_grey(mask) > 127
            if usable.shape != grey.shape:
                raise UserError(f"{mask} has another size than its photo; make it {grey.shape[1]} x {grey.shape[0]}.")
        file_size = (grey.shape[1], grey.shape[0])
        times = -(-max(file_size) // largest_side)
        if times > 1:
            grey = np.asarray(shrunk(grey, times).round(), np.uint8)
            usable = None if usable is None else shrunk(usable, times) == 1
        focal = exif_focal(path)
        photos.append(Photo(path.stem, grey, usable, file_size, times, None if focal is None else focal / times))
    if len(photos) < 3:
        raise UserError(f"{capture.folder}/images has {len(photos)} photos; take at least 12 all around the objects.")
    return photos
