"""Procedural textures: a repeating block of noise that gives every solid a print, and the foam's picture with tags."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.capture.layout import FOAM, TAG_PLACES
from pipeline.capture.markers import CELLS, tag_cells

VOXEL = 0.0005  # m
SIDE = 160  # voxels of the repeating block
FOAM_PIXEL = 0.00025  # m


def _noise(shape: tuple[int, ...], wavelengths: tuple[float, ...], random: np.random.Generator) -> NDArray[np.float64]:
    """Return periodic noise with values about 0, standard deviation 1, of these wavelengths in cells."""
    frequency = np.sqrt(sum(f**2 for f in np.meshgrid(*(np.fft.fftfreq(n) for n in shape), indexing="ij")))
    spectrum = sum(
        np.exp(-((np.log(np.maximum(frequency, 1e-9) * w)) ** 2) / 0.1) * w ** (len(shape) / 2) for w in wavelengths
    )
    noise = np.fft.ifftn(np.fft.fftn(random.standard_normal(shape)) * spectrum).real
    return np.asarray(noise / noise.std(), np.float64)


@dataclass(frozen=True)
class Print:
    """A repeating block of brightness and hue from which objects are carved."""

    brightness: NDArray[np.float32]  # (SIDE, SIDE, SIDE), 0 to 1
    hue: NDArray[np.float32]

    @staticmethod
    def make(random: np.random.Generator) -> Print:
        """Draw a block: sharp-edged patches, as of a printed label, under finer grain."""
        shape = (SIDE, SIDE, SIDE)
        patches = np.tanh(6 * _noise(shape, (22.0, 40.0), random))
        grain = _noise(shape, (5.0, 10.0), random)
        brightness = np.clip(0.5 + 0.2 * patches + 0.13 * grain, 0, 1)
        hue = np.clip(0.5 + 0.25 * np.tanh(5 * _noise(shape, (30.0, 53.0), random)), 0, 1)
        return Print(brightness.astype(np.float32), hue.astype(np.float32))

    def colours(
        self, points: NDArray[np.float32], colour: NDArray[np.float32], offset: NDArray[np.float32], contrast: float
    ) -> NDArray[np.float32]:
        """Return linear colours (n, 3) at ``points`` (n, 3) of a body.

        Args:
            colour: (3,) the body's own colour, kept alone when ``contrast`` is 0.
            offset: (3,) m, what part of the block the body is carved from.
        """
        cell = np.floor((points + offset) / np.float32(VOXEL)).astype(np.int64) % SIDE
        where = (cell[:, 0], cell[:, 1], cell[:, 2])
        bright, hue = self.brightness[where][:, None], self.hue[where][:, None]
        tint = hue * colour + (1 - hue) * colour[[1, 2, 0]]
        patterned = (0.08 + 1.3 * bright) * (0.35 + tint) * 0.75
        return np.asarray(contrast * patterned + (1 - contrast) * colour * 0.6, np.float32)


def foam_picture(tags: int, tag_size: float, random: np.random.Generator) -> NDArray[np.float32]:
    """Return the top of the foam (rows along -y, columns along +x), linear brightness 0 to 1, tags laid on it."""
    width, height = round(FOAM[0] / FOAM_PIXEL), round(FOAM[1] / FOAM_PIXEL)
    grain = _noise((height // 4, width // 4), (5.0, 12.0, 30.0), random).astype(np.float32)
    foam = np.clip(0.30 + 0.07 * cv2.resize(grain, (width, height), interpolation=cv2.INTER_CUBIC), 0.02, 1)
    foam = np.ascontiguousarray(foam, np.float32)
    border = np.full((CELLS + 2, CELLS + 2), 0.85, np.float32)
    for number, (x, y, yaw) in enumerate(TAG_PLACES[:tags]):
        sheet = border.copy()
        sheet[1:-1, 1:-1] = np.where(tag_cells(number) > 0, 0.85, 0.03)
        scale = 32  # pixels per cell, so that edges stay sharp when the sheet is turned
        sheet = np.kron(sheet, np.ones((scale, scale), np.float32))
        per_pixel = tag_size / (CELLS * scale) / FOAM_PIXEL
        c, s = np.cos(np.radians(yaw)) * per_pixel, np.sin(np.radians(yaw)) * per_pixel
        middle = (CELLS + 2) * scale / 2
        # From the sheet's pixel (u right, v down) to the foam's; pixel centres are at integers for OpenCV.
        column, row = x / FOAM_PIXEL + width / 2 - 0.5, height / 2 - y / FOAM_PIXEL - 0.5
        matrix = np.array([[c, s, column - (c + s) * (middle - 0.5)], [-s, c, row - (c - s) * (middle - 0.5)]])
        laid = cv2.warpAffine(sheet, matrix, (width, height), flags=cv2.INTER_AREA)
        there = cv2.warpAffine(np.ones_like(sheet), matrix, (width, height), flags=cv2.INTER_NEAREST) > 0
        foam[there] = laid[there]
    return foam


def foam_colours(picture: NDArray[np.float32], x: NDArray[np.float32], y: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the foam's brightness (n,) at scene positions ``x``, ``y`` (n,), m."""
    column = (x / FOAM_PIXEL + picture.shape[1] / 2 - 0.5).astype(np.float32)
    row = (picture.shape[0] / 2 - y / FOAM_PIXEL - 0.5).astype(np.float32)
    size = 32000  # OpenCV's limit of a side
    parts = [
        cv2.remap(
            picture,
            column[i : i + size][None],
            row[i : i + size][None],
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )[0]
        for i in range(0, len(column), size)
    ]
    return np.concatenate(parts) if parts else np.zeros(0, np.float32)
