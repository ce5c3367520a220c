"""Analytic prepared objects, so that the tests of synthesis need no other stage."""

from __future__ import annotations

import numpy as np
import trimesh

from pipeline.records.objects import PreparedObject
from tests.objects import Field, box_distance, cylinder_distance, exact_grid, prepared


def prepared_shape(name: str, mesh: trimesh.Trimesh, field: Field) -> PreparedObject:
    points, faces = trimesh.sample.sample_surface(mesh, 2048, seed=0)
    samples = {"surface_points": np.asarray(points), "surface_normals": np.asarray(mesh.face_normals[faces])}
    return prepared(name, mesh, **exact_grid(mesh, field, padding=0.02), **samples)


def box(name: str = "box", extents: tuple[float, float, float] = (0.042, 0.042, 0.042)) -> PreparedObject:
    return prepared_shape(name, trimesh.creation.box(extents), box_distance(np.array(extents) / 2))


def cylinder(name: str = "cylinder", radius: float = 0.0285, height: float = 0.105) -> PreparedObject:
    mesh = trimesh.creation.cylinder(radius, height, sections=64)
    return prepared_shape(name, mesh, cylinder_distance(radius, height / 2))
