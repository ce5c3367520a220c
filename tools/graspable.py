"""Which widths of objects the hand can hold.

Measured with synthesis and validation as configured, on upright shapes of 500 kg/m3: boxes of square base and 60 mm
height for a pinch (96 chains each), cylinders for a side grasp (192 chains). Chains that ended in a validated grasp:

=====  ========================================================================================================
pinch  15 mm wide: 39, 25: 46, 35: 50, 60: 41, 80: 27, 95: 19, 110: 9, 125: 3, 140: none
side   20 mm wide: none, 28: 3, 35: 9, 57: 42, 70: 27, 80: 6, 88: 1, 98: none; 57 mm wide, only 35 mm high: 32
=====  ========================================================================================================

The geometry of the hand alone agrees for the side grasp (contacts of ring finger and palm that face each other within
15 degrees are at most 81 mm apart) and says nothing for the pinch (210 mm).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pipeline.records.objects import PreparedObject

READILY = {"pinch": (0.015, 0.100), "side": (0.035, 0.080)}  # m
HARDLY = {"pinch": (0.010, 0.130), "side": (0.025, 0.090)}  # m; beyond, no grasp was found


def caliper_width(vertices: NDArray[np.float64]) -> float:
    """Return the smallest horizontal width (m) of a shape (V, 3): the gap of two upright parallel plates around it."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(vertices[:, :2])
    # The smallest width of a convex polygon is across one of its edges.
    across = vertices[hull.vertices, :2] @ hull.equations[:, :2].T
    return float(np.ptp(across, axis=0).min())


def verdict(style: str, prepared: PreparedObject) -> str:
    """Return in words whether the width of an object fits a style."""
    width = caliper_width(prepared.vertices)
    (low, high), (least, most) = READILY[style], HARDLY[style]
    said = f"{1000 * width:.1f} mm wide: "
    if low <= width <= high:
        return said + "fits"
    if least <= width <= most:
        return said + f"barely fits, expect few grasps ({1000 * low:.0f} to {1000 * high:.0f} mm are best)"
    return said + f"does not fit, expect no grasps ({1000 * low:.0f} to {1000 * high:.0f} mm are best)"
