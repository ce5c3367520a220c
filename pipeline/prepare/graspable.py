"""Which styles fit an object's size.

Measured with synthesis and validation as configured, on upright shapes of 500 kg/m3: boxes of square base and 60 mm
height for a pinch (96 chains each), cylinders for a side grasp (192 chains). Chains that ended in a validated grasp:

=====  ========================================================================================================
pinch  15 mm wide: 39, 25: 46, 35: 50, 60: 41, 80: 27, 95: 19, 110: 9, 125: 3, 140: none
side   20 mm wide: none, 28: 3, 35: 9, 57: 42, 70: 27, 80: 6, 88: 1, 98: none; 57 mm wide, only 35 mm high: 32
=====  ========================================================================================================

Boxes of width x depth x height in mm: for a pinch (48 chains) 40 x 40 x 15: 3, 40 x 40 x 25: 26, 50 x 120 x 60: 34; for
a side grasp (96 chains) 25 x 60 x 80: 19, 38 x 89 x 175: none, and none of four bodies lower than 23 mm.

The geometry of the hand alone agrees for the side grasp (contacts of ring finger and palm that face each other within
15 degrees are at most 81 mm apart) and says nothing for the pinch (210 mm).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

READILY = {"pinch": (0.015, 0.100), "side": (0.035, 0.080)}  # m
HARDLY = {"pinch": (0.010, 0.130), "side": (0.025, 0.090)}  # m; beyond, no grasp was found
LOWEST = {"pinch": 0.02, "side": 0.03}  # m; the support keeps the hand away from lower ones
DEEPEST = {"pinch": np.inf, "side": 0.08}  # m; the ring finger does not reach around more


@dataclass(frozen=True)
class Size:
    """The size of an upright object, m."""

    width: float  # the gap of two upright parallel plates around it, at its smallest
    depth: float  # its extent along those plates
    height: float


def size_of(vertices: NDArray[np.float64]) -> Size:
    """Return the size of a shape (V, 3), z up."""
    hull = ConvexHull(vertices[:, :2])
    # The smallest width of a convex polygon is across one of its edges.
    flat = vertices[hull.vertices, :2]
    normals = hull.equations[:, :2]
    widths = np.ptp(flat @ normals.T, axis=0)
    across = normals[widths.argmin()]
    depth = np.ptp(flat @ np.array([-across[1], across[0]]))
    return Size(float(widths.min()), float(depth), float(np.ptp(vertices[:, 2])))


def fitting_styles(size: Size) -> list[str]:
    """Return the styles in which an object of this size is readily grasped."""
    return [style for style in READILY if not misfit(style, size)]


def misfit(style: str, size: Size) -> str:
    """Return what of a size does not readily fit a style, '' if all does."""
    low, high = READILY[style]
    if not low <= size.width <= high:
        return f"{1000 * size.width:.1f} mm wide, {1000 * low:.0f} to {1000 * high:.0f} mm are best"
    if size.height < LOWEST[style]:
        return f"{1000 * size.height:.1f} mm high, at least {1000 * LOWEST[style]:.0f} mm are best"
    if size.depth > DEEPEST[style]:
        return f"{1000 * size.depth:.1f} mm deep, at most {1000 * DEEPEST[style]:.0f} mm are best"
    return ""


def verdict(style: str, size: Size) -> str:
    """Return in words whether a size fits a style."""
    reason = misfit(style, size)
    if not reason:
        return f"{1000 * size.width:.1f} mm wide: fits"
    least, most = HARDLY[style]
    barely = least <= size.width <= most and size.depth <= DEEPEST[style] and size.height >= LOWEST[style] / 2
    return f"{'barely fits, expect few' if barely else 'does not fit, expect no'} grasps ({reason})"
