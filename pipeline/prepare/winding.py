"""A closed surface around a soup of triangles: where its generalized winding number is one half.

Jacobson, Kavan and Sorkine-Hornung, "Robust inside-outside segmentation using generalized winding numbers" (2013);
the number itself is evaluated by Warp's mesh query.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

GRID_OFFSET = 0.371  # cells; keeps grid points off the planes of the shape, where distances are exactly 0


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
    import manifold3d

    low, high = vertices.min(axis=0), vertices.max(axis=0)
    spacing = float((high - low).max() / cells)
    shape = np.ceil((high - low) / spacing).astype(int) + 6
    origin = low - (3 - GRID_OFFSET) * spacing
    axes = [origin[axis] + spacing * np.arange(shape[axis]) for axis in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = -winding_distances(vertices, faces, points).reshape(tuple(shape)).astype(np.float64)
    last = [size - 2 for size in shape]
    flat, strides = inside.ravel().tolist(), (int(shape[1] * shape[2]), int(shape[2]))

    def interpolated(x: float, y: float, z: float) -> float:
        fx, fy, fz = (x - origin[0]) / spacing, (y - origin[1]) / spacing, (z - origin[2]) / spacing
        i, j, k = min(max(int(fx), 0), last[0]), min(max(int(fy), 0), last[1]), min(max(int(fz), 0), last[2])
        u, v, w = fx - i, fy - j, fz - k
        at = i * strides[0] + j * strides[1] + k
        rows = []
        for offset in (0, strides[1], strides[0], strides[0] + strides[1]):
            rows.append(flat[at + offset] * (1 - w) + flat[at + offset + 1] * w)
        return (rows[0] * (1 - v) + rows[1] * v) * (1 - u) + (rows[2] * (1 - v) + rows[3] * v) * u

    box = [*(low - 2 * spacing), *(high + 2 * spacing)]
    surface = manifold3d.Manifold.level_set(interpolated, box, spacing, 0.0).to_mesh64()
    return np.asarray(surface.vert_properties, np.float64)[:, :3], np.asarray(surface.tri_verts).astype(np.int64)
