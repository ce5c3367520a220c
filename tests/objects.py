"""Prepared objects made of meshes, so that tests need no other stage."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from pipeline.records.objects import PreparedObject

Field = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def prepared(name: str, mesh: trimesh.Trimesh, density: float = 500.0, **fields: Any) -> PreparedObject:
    """A convex shape in the frame of its mesh, without a distance grid and with its corners as samples.

    ``fields`` take the place of what follows from the mesh.
    """
    mesh = mesh.copy()
    mesh.density = density
    vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
    own = {
        "parts": ((vertices, faces),),
        "distance": np.zeros((0, 0, 0), np.float32),
        "distance_origin": np.zeros(3),
        "distance_spacing": 0.001,
        "surface_points": vertices,
        "surface_normals": np.asarray(mesh.vertex_normals),
        "mass": float(mesh.mass),
        "inertia": np.asarray(mesh.moment_inertia),
        "volume": float(mesh.volume),
        "extents": np.asarray(mesh.extents),
        "provenance": {},
    }
    return PreparedObject(name=name, vertices=vertices, faces=faces, **{**own, **fields})


def exact_grid(mesh: trimesh.Trimesh, field: Field, padding: float, cells: int = 48) -> dict[str, Any]:
    """Fields of a prepared object whose grid of distances, beyond the mesh by ``padding`` m, is exact at its cells."""
    low, high = mesh.bounds[0] - padding, mesh.bounds[1] + padding
    spacing = float((high - low).max() / (cells - 1))
    axes = [low[k] + spacing * np.arange(np.ceil((high - low)[k] / spacing) + 1) for k in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
    return {"distance": field(grid).astype(np.float32), "distance_origin": low, "distance_spacing": spacing}


def box_distance(half: NDArray[np.float64]) -> Field:
    def field(p: NDArray[np.float64]) -> NDArray[np.float64]:
        q = np.abs(p) - half
        return np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(q.max(-1), 0)

    return field


def cylinder_distance(radius: float, half_height: float) -> Field:
    def field(p: NDArray[np.float64]) -> NDArray[np.float64]:
        q = np.stack([np.linalg.norm(p[..., :2], axis=-1) - radius, np.abs(p[..., 2]) - half_height], -1)
        return np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(q.max(-1), 0)

    return field
