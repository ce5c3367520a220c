"""From ideal light to what a camera stores: exposure, shake, defocus, noise, eight bits, JPEG."""

from __future__ import annotations

import io
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pipeline.records.parameters.capture import RenderingParameters


def photograph(
    light: NDArray[np.float32], settings: RenderingParameters, random: np.random.Generator
) -> NDArray[np.uint8]:
    """Return the stored pixels (h, w, 3), sRGB-like gamma, of a picture in linear light."""
    picture: Any = light * np.float32(np.exp(settings.exposure * random.standard_normal()))
    angle, length = np.pi * random.random(), settings.motion_blur * random.random()
    if length > 0.5:
        size = 2 * int(np.ceil(length / 2)) + 3
        kernel = np.zeros((size, size), np.float32)
        for step in np.linspace(-length / 2, length / 2, 8 * size):
            x, y = size // 2 + step * np.cos(angle), size // 2 + step * np.sin(angle)
            column, row, u, v = int(x), int(y), x % 1, y % 1
            kernel[row, column] += (1 - u) * (1 - v)
            kernel[row, column + 1] += u * (1 - v)
            kernel[row + 1, column] += (1 - u) * v
            kernel[row + 1, column + 1] += u * v
        picture = cv2.filter2D(picture, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REFLECT)
    if settings.blur:
        picture = cv2.GaussianBlur(picture, (0, 0), settings.blur)
    stored = np.clip(picture, 0, 1) ** np.float32(1 / 2.2)
    stored += settings.noise * random.standard_normal(stored.shape, dtype=np.float32)
    return (np.clip(stored, 0, 1) * 255 + 0.5).astype(np.uint8)


def jpeg_bytes(pixels: NDArray[np.uint8], quality: int) -> bytes:
    """Return a JPEG file without metadata."""
    target = io.BytesIO()
    Image.fromarray(pixels).save(target, format="JPEG", quality=quality)
    return target.getvalue()
