"""Colours that mean the same in all pictures, pages and videos, and their two notations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def hexadecimal(colour: Sequence[float] | NDArray[np.float64]) -> str:
    """Return a colour (sRGB, 0 to 1) in the notation of HTML."""
    return "#" + "".join(f"{round(255 * channel):02x}" for channel in colour)


def fractions(colour: str) -> tuple[float, float, float]:
    """Return a colour in the notation of HTML as sRGB, 0 to 1."""
    return int(colour[1:3], 16) / 255, int(colour[3:5], 16) / 255, int(colour[5:7], 16) / 255


OBJECT_COLOURS_HTML = ("#e08a2e", "#3c78b4", "#5c9e59", "#9966a6")  # of objects, in the order of picking
OBJECT_COLOURS = tuple(fractions(colour) for colour in OBJECT_COLOURS_HTML)  # the same, sRGB, 0 to 1
SPONGE_COLOUR = (0.58, 0.62, 0.54)
