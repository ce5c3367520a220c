"""Shape recipes: solids that are built from nothing but their name and extents.

Boxes and cylinders are exact. Cans, bottles and the carton are stacks of rounded-rectangle rings
(:mod:`pipeline.prepare.recipes_vessels`); the toys are unions of round and flat solids
(:mod:`pipeline.prepare.recipes_toys`). Proportions follow the extents, volumes and support of the paper's objects.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.prepare import recipes_toys, recipes_vessels
from pipeline.records.parameters.objects import Recipe

CYLINDER_SEGMENTS = 64  # the sagitta of a 57 mm cylinder is 0.03 mm; few enough that one convex part keeps all vertices
DIGITS = 8  # of a metre; what is left of the last digit of sine and cosine, which differs between machines


def box_mesh(extents: tuple[float, float, float]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return vertices (8, 3) and outward faces (12, 3) of a box centred at the origin."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * np.array(extents) / 2
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return corners, np.array([t for a, b, c, d in quads for t in ([a, b, c], [a, c, d])])


def cylinder_mesh(extents: tuple[float, float, float]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return an upright (elliptic) cylinder centred at the origin; its extents are exact."""
    count = CYLINDER_SEGMENTS
    angle = 2 * np.pi * np.arange(count) / count
    # Rounded so that the last digit of sine and cosine, which differs between machines, does not matter.
    ring = np.round(np.stack([np.cos(angle), np.sin(angle)], axis=1), 9) * np.array(extents[:2]) / 2
    low = np.column_stack([ring, np.full(count, -extents[2] / 2)])
    high = np.column_stack([ring, np.full(count, extents[2] / 2)])
    here, following = np.arange(count), (np.arange(count) + 1) % count
    fan = np.arange(1, count - 1)
    faces = [
        np.stack([here, following, following + count], axis=1),
        np.stack([here, following + count, here + count], axis=1),
        np.stack([np.zeros_like(fan), fan + 1, fan], axis=1),
        np.stack([np.zeros_like(fan), fan, fan + 1], axis=1) + count,
    ]
    return np.concatenate([low, high]), np.concatenate(faces)


def fitted(vertices: NDArray[np.float64], extents: tuple[float, float, float]) -> NDArray[np.float64]:
    """Return vertices (V, 3) moved and stretched into the box of these extents (m) centred at the origin."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return np.round((vertices - (low + high) / 2) / (high - low) * np.array(extents), DIGITS)


def recipe_mesh(recipe: Recipe, extents: tuple[float, float, float]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return vertices (V, 3) in metres and outward faces (F, 3) of one closed solid standing with +z up."""
    if recipe == "box":
        return box_mesh(extents)
    if recipe == "cylinder":
        return cylinder_mesh(extents)
    toys = {"duck": recipes_toys.duck, "bunny": recipes_toys.bunny, "train": recipes_toys.train}
    vertices, faces = toys[recipe]() if recipe in toys else recipes_vessels.vessel(recipe)
    return fitted(vertices, extents), faces
