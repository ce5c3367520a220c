"""What of some surfaces a camera sees."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.reconstruct.surface import Surface
from pipeline.shapes.rays import ray_scene

LIFT = 0.0005  # m off a surface, so that it does not hide its own points


class Bodies:
    """Surfaces that hide each other."""

    def __init__(self, surfaces: Sequence[Surface]) -> None:
        self._rays = ray_scene(*((surface.vertices, surface.faces) for surface in surfaces))

    def hits(
        self, origin: NDArray[np.float64], rays: NDArray[np.float64]
    ) -> tuple[NDArray[np.float32], NDArray[np.int64], NDArray[np.float32]]:
        """Return what ``rays`` (n, 3) from ``origin`` (3,) meet: how far in their lengths (n,), infinite for nothing;
        the number of the surface (n,), -1 for none; and its normals (n, 3).
        """
        query = np.concatenate([np.broadcast_to(origin, rays.shape), rays], axis=1).astype(np.float32)
        found = self._rays.cast_rays(query, nthreads=1)
        distance = found["t_hit"].numpy()
        number = np.where(np.isfinite(distance), found["geometry_ids"].numpy().astype(np.int64), -1)
        return distance, number, found["primitive_normals"].numpy()

    def depth(
        self, own: int, origin: NDArray[np.float64], rays: NDArray[np.float64], largest_angle: float
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return how far (n,), in lengths of ``rays`` (n, 3), the surface number ``own`` is, and its normals (n, 3).

        The distance is 0 where something else is nearer, or nothing is hit, or the surface is seen too flatly.

        Args:
            origin: (3,) where the camera is.
            largest_angle: degrees between ray and normal beyond which a hit does not count.
        """
        distance, number, normals = self.hits(origin, rays)
        cosine = -(normals * rays).sum(axis=1) / np.linalg.norm(rays, axis=1)
        good = (number == own) & (np.abs(cosine) > np.cos(np.radians(largest_angle)))
        return np.asarray(np.where(good, distance, 0), np.float32), np.asarray(normals, np.float32)

    def seen_from(
        self, camera: NDArray[np.float64], points: NDArray[np.float64], normals: NDArray[np.float32]
    ) -> NDArray[np.bool_]:
        """Return which points (n, 3) with outward normals (n, 3) a camera (3,) sees: turned to it and not covered."""
        towards = camera - points
        facing = (towards * normals).sum(axis=1) > 0.2 * np.linalg.norm(towards, axis=1)
        query = np.concatenate([points + LIFT * normals, towards], axis=1).astype(np.float32)
        covered = self._rays.test_occlusions(query, tnear=0.0, tfar=1.0, nthreads=1).numpy()
        return np.asarray(facing & ~covered)
