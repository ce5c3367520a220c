"""Tags as pictures."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.records.tag_layouts import TAG_FAMILIES, TagLayout, opencv_name

FAMILY = "tag36h11"  # of the tags in rendered captures
CELLS = TAG_FAMILIES[FAMILY][1] + 2  # of the black square's edge, border included


def tag_cells(number: int, family: str = FAMILY, border: int = 1) -> NDArray[np.uint8]:
    """Return the cells (n, n) of a tag, black border included, 0 black and 255 white, as OpenCV draws it."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, opencv_name(family)))
    cells = TAG_FAMILIES[family][1] + 2 * border
    return np.asarray(cv2.aruco.generateImageMarker(dictionary, number, cells, borderBits=border), np.uint8)


def printed_cells(number: int, layout: TagLayout) -> NDArray[np.uint8]:
    """Return the cells (n, n) of a tag as a layout's convention turns it."""
    cells = tag_cells(number, layout.family, layout.border)
    return np.rot90(cells, 2) if layout.convention == "apriltag" else cells
