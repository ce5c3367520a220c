"""Analytic prepared objects, so that the tests of synthesis need no other stage."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import trimesh
from numpy.typing import NDArray

from pipeline.records.objects import PreparedObject

Field = Callable[[NDArray[np.float64]], NDArray[np.float64]]


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


def prepared_shape(name: str, mesh: trimesh.Trimesh, field: Field, cells: int = 48, padding: float = 0.02):
    low, high = mesh.bounds[0] - padding, mesh.bounds[1] + padding
    spacing = float((high - low).max() / (cells - 1))
    counts = np.ceil((high - low) / spacing).astype(int) + 1
    axes = [low[k] + spacing * np.arange(counts[k]) for k in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
    points, faces = trimesh.sample.sample_surface(mesh, 2048, seed=0)
    return PreparedObject(
        name=name,
        vertices=np.asarray(mesh.vertices, np.float64),
        faces=np.asarray(mesh.faces, np.int64),
        parts=((np.asarray(mesh.vertices), np.asarray(mesh.faces)),),
        distance=field(grid).astype(np.float32),
        distance_origin=low,
        distance_spacing=spacing,
        surface_points=np.asarray(points, np.float64),
        surface_normals=np.asarray(mesh.face_normals[faces], np.float64),
        mass=float(500 * mesh.volume),
        inertia=np.asarray(500 * mesh.moment_inertia),
        volume=float(mesh.volume),
        extents=np.asarray(mesh.extents),
        provenance={},
    )


def box(name: str = "box", extents: tuple[float, float, float] = (0.042, 0.042, 0.042)) -> PreparedObject:
    return prepared_shape(name, trimesh.creation.box(extents), box_distance(np.array(extents) / 2))


def cylinder(name: str = "cylinder", radius: float = 0.0285, height: float = 0.105) -> PreparedObject:
    mesh = trimesh.creation.cylinder(radius, height, sections=64)
    return prepared_shape(name, mesh, cylinder_distance(radius, height / 2))
