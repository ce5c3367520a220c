"""Cans, bottles and a carton: rings stacked from the bottom to the top, in millimetres.

A ring is the outline of a rounded rectangle, which is a circle when its corner radius is half its sides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

CORNER_POINTS = 12  # per quarter of a ring
FILLET_POINTS = 4  # per rounded edge


@dataclass(frozen=True)
class Ring:
    """One horizontal outline, mm."""

    half_x: float
    half_y: float
    corner: float  # radius
    height: float


def round_rings(*profile: tuple[float, float]) -> list[Ring]:
    """Return circles of (radius, height)."""
    return [Ring(radius, radius, radius, height) for radius, height in profile]


def fillet(begin: tuple[float, float], corner: tuple[float, float], end: tuple[float, float]) -> list[Ring]:
    """Return circles along a parabola from ``begin`` to ``end``, tangent to the lines through ``corner``."""
    rings = []
    for step in range(FILLET_POINTS + 1):
        t = step / FILLET_POINTS
        weights = ((1 - t) * (1 - t), 2 * t * (1 - t), t * t)
        radius = weights[0] * begin[0] + weights[1] * corner[0] + weights[2] * end[0]
        height = weights[0] * begin[1] + weights[1] * corner[1] + weights[2] * end[1]
        rings += round_rings((radius, height))
    return rings


def outline(ring: Ring) -> NDArray[np.float64]:
    """Return the points (4 * CORNER_POINTS, 3) of a ring, anticlockwise from +x.

    No point lies where two corners meet, so a circle has none twice.
    """
    angle = np.pi / 2 * (np.arange(CORNER_POINTS) + 0.5) / CORNER_POINTS
    # Rounded so that the last digit of sine and cosine, which differs between machines, does not matter.
    arc = np.round(np.stack([np.cos(angle), np.sin(angle)], axis=1), 9) * ring.corner
    centre = np.array([ring.half_x - ring.corner, ring.half_y - ring.corner])
    first = arc + centre
    quarters = [first, first[::-1] * (-1, 1), first * (-1, -1), first[::-1] * (1, -1)]
    flat = np.concatenate(quarters)
    return np.column_stack([flat, np.full(len(flat), ring.height)])


def stacked(rings: list[Ring]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return vertices (V, 3) and outward faces (F, 3) of the solid between consecutive rings, closed at both ends."""
    count = 4 * CORNER_POINTS
    vertices = np.concatenate([outline(ring) for ring in rings])
    ends = np.array([[0, 0, rings[0].height], [0, 0, rings[-1].height]])
    here, following = np.arange(count), (np.arange(count) + 1) % count
    faces = []
    for level in range(len(rings) - 1):
        low, high = level * count, (level + 1) * count
        faces.append(np.stack([low + here, low + following, high + following], axis=1))
        faces.append(np.stack([low + here, high + following, high + here], axis=1))
    bottom, top = np.full(count, len(vertices)), np.full(count, len(vertices) + 1)
    last = (len(rings) - 1) * count
    faces += [np.stack([bottom, following, here], axis=1), np.stack([top, last + here, last + following], axis=1)]
    return np.concatenate([vertices, ends]), np.concatenate(faces)


def bottle() -> list[Ring]:
    """Return a squat bottle: straight body, round shoulder, short neck, screw cap."""
    return [
        *round_rings((15.0, 1.2), (17.5, 0.0)),
        *fillet((18.6, 0.0), (21.7, 0.0), (21.7, 3.0)),
        *fillet((21.7, 37.0), (21.7, 49.0), (11.0, 51.5)),
        *round_rings((10.2, 52.5), (10.2, 54.5), (12.6, 54.5)),
        *fillet((12.6, 63.8), (12.6, 65.5), (10.9, 65.5)),
    ]


def medicine_bottle() -> list[Ring]:
    """Return a pill bottle: wide body, sloping shoulder, broad cap with a step."""
    return [
        *round_rings((21.0, 1.5), (25.5, 0.0)),
        *fillet((27.4, 0.0), (30.9, 0.0), (30.9, 3.5)),
        *fillet((30.9, 76.0), (30.9, 84.0), (24.5, 86.5)),
        *round_rings((21.5, 87.6), (21.5, 89.0), (24.4, 89.0), (24.4, 93.0), (23.6, 93.6)),
        *fillet((23.6, 108.0), (23.6, 110.3), (21.3, 110.3)),
    ]


def oval_medicine_bottle() -> list[Ring]:
    """Return a flat bottle of oval section with a round neck and cap."""
    body = [(0.90, 0.0), (0.955, 0.6), (0.985, 1.8), (1.0, 3.5), (1.0, 67.0), (0.985, 71.0), (0.93, 74.8), (0.83, 78.2)]
    rings = [Ring(18.25 * share, 26.95 * share, 17.5 * share, height) for share, height in body]
    rings += [Ring(12.4, 17.0, 12.4, 81.2), *round_rings((10.8, 82.8), (10.8, 84.4), (13.4, 84.4))]
    return rings + fillet((13.4, 99.6), (13.4, 101.8), (11.2, 101.8))


def soda_can() -> list[Ring]:
    """Return a drink can: domed bottom on a narrow stand, straight wall, neck, rim, sunken lid."""
    return [
        *round_rings((4.0, 8.0), (13.0, 6.6), (19.0, 3.6), (22.3, 0.3), (23.2, 0.0), (24.4, 0.2)),
        *round_rings((26.0, 2.2)),
        *fillet((29.5, 6.3), (33.2, 9.0), (33.2, 13.5)),
        *fillet((33.2, 101.0), (33.2, 106.0), (29.6, 112.0)),
        *round_rings((26.9, 115.8), (26.9, 116.6), (27.8, 117.2), (28.0, 118.2), (27.5, 118.8), (26.6, 118.4)),
        *round_rings((25.3, 113.6), (23.8, 113.4), (22.8, 115.6)),
    ]


def beverage_carton() -> list[Ring]:
    """Return a carton with soft vertical edges, sloping shoulders and a screw cap."""
    body = [(0.93, 0.0), (0.985, 0.5), (1.0, 2.0), (1.0, 80.0), (0.985, 82.0)]
    rings = [Ring(23.4 * share, 34.2 * share, 5.0, height) for share, height in body]
    rings += [Ring(14.6, 23.0, 4.5, 100.6), Ring(13.4, 21.6, 4.5, 101.4)]
    rings += round_rings((10.4, 101.9), (10.4, 103.2), (12.0, 103.2))
    return rings + fillet((12.0, 113.6), (12.0, 115.4), (10.2, 115.4))


def spray_can() -> list[Ring]:
    """Return a slim aerosol can: rolled bottom rim, round shoulder, straight overcap with a groove below it."""
    return [
        *round_rings((9.0, 2.6), (14.6, 1.2), (15.6, 0.0), (17.0, 0.0), (17.4, 0.7), (17.4, 1.7), (16.9, 2.3)),
        *round_rings((17.65, 3.4)),
        *fillet((17.65, 88.0), (17.65, 91.0), (16.2, 92.6)),
        *round_rings((15.7, 93.2), (15.7, 94.4), (16.9, 94.6)),
        *fillet((16.9, 116.0), (16.9, 126.0), (7.5, 126.7)),
    ]


def vessel(recipe: str) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the solid of a recipe of this module, mm."""
    recipes = (bottle, medicine_bottle, oval_medicine_bottle, soda_can, beverage_carton, spray_can)
    return stacked({build.__name__: build for build in recipes}[recipe]())
