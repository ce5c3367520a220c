"""PNG files of pictures, with captions; the same pixels give the same bytes."""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

CAPTION_HEIGHT = 26
GAP = 6  # between pictures of a strip
TEXT_SIZE = 15
INK = (45, 48, 54)
PAPER = (250, 250, 251)


def captioned(picture: NDArray[np.uint8], caption: str) -> NDArray[np.uint8]:
    """Return the picture with a line of text below it."""
    height, width = picture.shape[:2]
    canvas = Image.new("RGB", (width, height + CAPTION_HEIGHT), PAPER)
    canvas.paste(Image.fromarray(picture), (0, 0))
    font = ImageFont.load_default(size=TEXT_SIZE)
    ImageDraw.Draw(canvas).text((8, height + CAPTION_HEIGHT / 2), caption, fill=INK, font=font, anchor="lm")
    return np.asarray(canvas)


def strip(pictures: Sequence[NDArray[np.uint8]], captions: Sequence[str] = ()) -> NDArray[np.uint8]:
    """Return pictures of equal height side by side, each with its caption if captions are given."""
    if captions:
        pictures = [captioned(picture, caption) for picture, caption in zip(pictures, captions, strict=True)]
    between = np.full((pictures[0].shape[0], GAP, 3), PAPER, np.uint8)
    row = [part for picture in pictures for part in (picture, between)][:-1]
    return np.concatenate(row, axis=1)


def png_bytes(picture: NDArray[np.uint8]) -> bytes:
    """Return the picture (h, w, 3) as a PNG without metadata."""
    target = io.BytesIO()
    Image.fromarray(picture).save(target, format="PNG", optimize=False, compress_level=6)
    return target.getvalue()
