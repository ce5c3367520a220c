"""Volume, centre of mass and inertia of a closed triangle mesh of uniform density; objects of another mass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.records.objects import PreparedObject


def solid_properties(
    vertices: NDArray[np.float64], faces: NDArray[np.int64]
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Return volume (m3), centre of mass (3,) and inertia per density (3, 3) about that centre (m5).

    Sums over the tetrahedra between a reference point and each face; the second moments of a tetrahedron with one
    vertex at the reference and the others at a, b, c are ``V / 20 (s s^T + a a^T + b b^T + c c^T)``, s = a + b + c.
    """
    reference = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    corners = (vertices - reference)[faces]
    volumes = np.linalg.det(corners) / 6
    volume = float(volumes.sum())
    total = corners.sum(axis=1)
    first = (volumes[:, None] * total).sum(axis=0) / 4
    second = np.einsum("f,fi,fj->ij", volumes, total, total) + np.einsum("f,fki,fkj->ij", volumes, corners, corners)
    second /= 20
    centre = first / volume
    second -= volume * np.outer(centre, centre)
    inertia = np.trace(second) * np.eye(3) - second
    return volume, centre + reference, (inertia + inertia.T) / 2


def weighted(prepared: PreparedObject, mass_factor: float, centre: NDArray[np.float64]) -> PreparedObject:
    """Return an object of another mass and centre of mass, whose frame has its origin there, as every object's does.

    What physics takes is right: parts, vertices, mass, inertia. The distance grid and the surface samples stay those of
    the old frame.

    Args:
        mass_factor: of mass and of inertia, the latter about the new centre.
        centre: (3,) the new centre of mass in the frame of ``prepared``, m.
    """
    return replace(
        prepared,
        vertices=prepared.vertices - centre,
        parts=tuple((vertices - centre, faces) for vertices, faces in prepared.parts),
        mass=mass_factor * prepared.mass,
        inertia=mass_factor * prepared.inertia,
    )
