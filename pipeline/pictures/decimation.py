"""Meshes with fewer faces, for pictures that do not show the difference."""

from __future__ import annotations

import numpy as np
import open3d
from numpy.typing import NDArray

Mesh = tuple[NDArray[np.float64], NDArray[np.int64]]  # vertices (V, 3), m; faces (F, 3)


def decimated(mesh: Mesh, most_faces: int) -> Mesh:
    """Return the mesh with at most about ``most_faces`` faces (quadric edge collapse), or unchanged if it has fewer."""
    vertices, faces = mesh
    if len(faces) <= most_faces:
        return mesh
    full = open3d.geometry.TriangleMesh(open3d.utility.Vector3dVector(vertices), open3d.utility.Vector3iVector(faces))
    full.merge_close_vertices(1e-7)
    less = full.simplify_quadric_decimation(most_faces)
    return np.asarray(less.vertices), np.asarray(less.triangles, dtype=np.int64)
