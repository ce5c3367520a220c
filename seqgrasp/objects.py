"""Objects from triangles of your own."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.records.parameters.objects import MeshParameters

if TYPE_CHECKING:
    from pipeline.records.objects import PreparedObject
    from pipeline.records.parameters import Parameters

Axis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
Unit = Literal["m", "cm", "mm", "inch"]


def read_mesh(file: str | os.PathLike[str], unit: Unit) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the vertices (V, 3), m, and faces (F, 3) of a mesh file, in the axes of the file.

    Raises:
        UserError: the file is missing, or holds no triangle mesh.
    """
    from pipeline.prepare.sources import UNIT_LENGTHS, check_file, load_triangles

    path = Path(file)
    check_file(path, "read_mesh")
    vertices, faces = load_triangles(path, "read_mesh")
    return vertices * UNIT_LENGTHS[unit], faces


def prepare_mesh(
    name: str,
    vertices: ArrayLike,
    faces: ArrayLike,
    parameters: Parameters,
    *,
    up: Axis = "+z",
    density: float = 500.0,
) -> PreparedObject:
    """Return a mesh as an object that can be grasped: repaired, in its own frame, with collision shape and distances.

    Args:
        name: identifies the object; its surface samples and its grasps are drawn from a seed that depends on it.
        vertices: (V, 3), m, in any frame.
        faces: (F, 3) indices into the vertices.
        parameters: of which `prepare` is used.
        up: which axis of the mesh points up while the object stands.
        density: kg/m3, uniform.

    Raises:
        UserError: the mesh cannot be made one solid that stands.
    """
    from pipeline.prepare.preparation import prepare_object
    from pipeline.prepare.sources import RawMesh

    shape = MeshParameters.model_validate({"file": f"data/raw/{name}", "unit": "m", "up": up, "density": density})
    raw = RawMesh(np.asarray(vertices, np.float64), np.asarray(faces, np.int64), "Python", "as supplied by the user")
    return prepare_object(name, shape, parameters.prepare, raw)
