"""AprilTags as pictures."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

CELLS = 8  # of the black square's edge, border included


def tag_cells(number: int) -> NDArray[np.uint8]:
    """Return the cells (8, 8) of a tag of the family 36h11, 0 black and 255 white, as OpenCV draws it."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    return np.asarray(cv2.aruco.generateImageMarker(dictionary, number, CELLS), np.uint8)
