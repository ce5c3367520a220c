"""A closed surface around a soup of triangles: where its generalized winding number is one half.

Jacobson, Kavan and Sorkine-Hornung, "Robust inside-outside segmentation using generalized winding numbers" (2013);
the number itself is evaluated by Warp's mesh query.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.prepare.level_set import sampling_grid, zero_surface


@lru_cache(maxsize=1)
def _kernel() -> Any:
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR

    @wp.kernel(module="unique")
    def sign_distances(mesh: wp.uint64, points: wp.array(dtype=wp.vec3), reach: float, out: wp.array(dtype=float)):  # type: ignore[valid-type, no-untyped-def]
        i = wp.tid()
        query = wp.mesh_query_point_sign_winding_number(mesh, points[i], reach)
        nearest = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
        out[i] = query.sign * wp.length(points[i] - nearest)

    return sign_distances


def winding_distances(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], points: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Return distances (n,) of ``points`` (n, 3) to the triangles, negative where the winding number is over 0.5."""
    import warp as wp

    kernel = _kernel()
    mesh = wp.Mesh(
        wp.array(vertices.astype(np.float32), dtype=wp.vec3, device="cpu"),
        wp.array(faces.astype(np.int32).ravel(), dtype=int, device="cpu"),
        support_winding_number=True,
    )
    out = wp.zeros(len(points), dtype=float, device="cpu")
    reach = float(np.ptp(np.concatenate([vertices, points]), axis=0).sum())
    query = wp.array(points.astype(np.float32), dtype=wp.vec3, device="cpu")
    wp.launch(kernel, dim=len(points), inputs=[mesh.id, query, reach, out], device="cpu")
    return np.asarray(out.numpy())


def winding_surface(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], cells: int
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the closed surface (vertices, outward faces) on a grid of ``cells`` along the longest axis."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    spacing = float((high - low).max() / cells)
    points, origin, shape = sampling_grid(low, high, spacing)
    inside = -winding_distances(vertices, faces, points).reshape(shape).astype(np.float64)
    return zero_surface(inside, origin, spacing, low, high)
