"""Meshes of descriptions: read from any format, and the convex solids by which links collide."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from pipeline.hand.urdf import origin_matrix, vector

FACETS = 32  # of a cylinder's circle
UNSHAPED_MASS = 0.005  # kg, of a moving link for which a description gives neither shape nor inertia
UNSHAPED_RADIUS = 0.01  # m, of the ball that it is taken for


@lru_cache(maxsize=64)
def read_mesh(file: Path) -> trimesh.Trimesh:
    """Return all meshes of a file as one, in the file's frame.

    Raises:
        ValueError: it cannot be read.
    """
    if file.suffix.lower() == ".dae":
        return _read_collada(file)
    try:
        loaded = trimesh.load_scene(file, process=False)
        mesh = loaded.to_mesh()
    except Exception as error:
        raise ValueError(f"{file} cannot be read as a mesh ({error})") from error
    if not len(mesh.faces):
        raise ValueError(f"{file} holds no triangles")
    return mesh


def _read_collada(file: Path) -> trimesh.Trimesh:
    import coal

    try:
        found = coal.MeshLoader().load(str(file), np.ones(3))
    except Exception as error:
        raise ValueError(f"{file} cannot be read as a mesh ({error})") from error
    faces = [[found.tri_indices(index)[corner] for corner in range(3)] for index in range(found.num_tris)]
    return trimesh.Trimesh(np.array(found.vertices()), np.array(faces), process=False)


def scaled_mesh(element: ElementTree.Element) -> trimesh.Trimesh:
    """Return the mesh of a ``<mesh>``, with its scale."""
    mesh = read_mesh(Path(element.get("filename", ""))).copy()
    return mesh.apply_scale(vector(element.get("scale", "1 1 1")))


def solid(collision: ElementTree.Element) -> trimesh.Trimesh:
    """Return the convex solid that physics takes for a ``<collision>``, link frame; of a mesh, its hull."""
    geometry = collision.find("geometry")
    assert geometry is not None
    shape = geometry[0]
    if shape.tag == "box":
        mesh = trimesh.creation.box(vector(shape.get("size")))
    elif shape.tag == "sphere":
        mesh = trimesh.creation.icosphere(subdivisions=3, radius=float(shape.get("radius", "")))
    elif shape.tag == "cylinder":
        mesh = trimesh.creation.cylinder(
            radius=float(shape.get("radius", "")), height=float(shape.get("length", "")), sections=FACETS
        )
    else:
        mesh = scaled_mesh(shape).convex_hull
    return mesh.apply_transform(origin_matrix(collision.find("origin")))


@dataclass(frozen=True)
class Inertia:
    """Mass, kg, centre of mass (3,), m, and inertia (3, 3) about it, kg m2, axes of the link frame."""

    mass: float
    centre: NDArray[np.float64]
    about_centre: NDArray[np.float64]


def inertia_of(solids: Sequence[trimesh.Trimesh], density: float) -> Inertia:
    """Return the inertia of solids of one density, kg/m3, as if they did not overlap; without any, of a small ball."""
    if not solids:
        moment = 0.4 * UNSHAPED_MASS * UNSHAPED_RADIUS**2
        return Inertia(UNSHAPED_MASS, np.zeros(3), moment * np.eye(3))
    masses = np.array([density * one.volume for one in solids])
    centres = np.array([one.center_mass for one in solids])
    middle = masses @ centres / masses.sum()
    total = np.zeros((3, 3))
    for mass, centre, one in zip(masses, centres, solids, strict=True):
        away = centre - middle
        total += density * one.moment_inertia + mass * (away @ away * np.eye(3) - np.outer(away, away))
    return Inertia(float(masses.sum()), middle, total)


def write_mesh(file: Path, vertices: ArrayLike, faces: ArrayLike) -> None:
    """Write a Wavefront file, which every loader reads."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in np.asarray(vertices, np.float64).tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (np.asarray(faces) + 1).tolist()]
    file.write_text("\n".join(lines) + "\n")
