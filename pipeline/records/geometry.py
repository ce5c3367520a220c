"""Meshes and point clouds from untrusted files: nothing but the file itself is read.

A mesh file can name others (materials and pictures of obj, glb and ply). They are not looked for: shape is all that is
wanted, a picture can unpack to any size, and a name can lead to a device, a pipe or the network. The one exception is a
plain file beside a ``.gltf`` that holds its numbers.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pipeline.records.gltf import shapes_alone
from pipeline.records.packages import KINDS, check_unpacked, shape_in
from pipeline.records.polygons import has_polygons, read_obj, read_off
from pipeline.records.triangles import sound_stl

if TYPE_CHECKING:
    import trimesh

FORMATS = (*KINDS, "zip")
MOST_TRIANGLES = 20_000_000  # 40 times the finest YCB scan; a scene of few bytes can repeat one mesh without end


def read_geometry(content: bytes, file_type: str, process: bool = False) -> Any:
    """Return a ``trimesh.Trimesh``, or a ``PointCloud`` where there are no faces.

    A scene becomes one mesh, its transforms applied.

    Args:
        file_type: one of :data:`~pipeline.records.packages.KINDS`.
        process: whether equal vertices are merged.

    Raises:
        ValueError: it is of another format or damaged, or holds no shape.
    """
    import trimesh

    if file_type not in KINDS:
        raise ValueError(f"the format {file_type!r} is not read")
    try:
        if file_type == "off" or (file_type == "obj" and has_polygons(content)):
            vertices, faces = read_off(content) if file_type == "off" else read_obj(content)
            _check_arrays(vertices, faces)
            return trimesh.Trimesh(vertices, faces, process=process)
        if file_type == "glb":
            content = shapes_alone(content)
        elif file_type == "stl":
            content = sound_stl(content)
        elif file_type in ("dae", "3mf"):
            check_unpacked(content, file_type)
        loaded: Any = trimesh.load(
            io.BytesIO(content), file_type=file_type, resolver=None, process=process, skip_materials=True
        )
        mesh = _one(loaded) if isinstance(loaded, trimesh.Scene) else loaded
        _check_arrays(np.asarray(mesh.vertices), np.asarray(getattr(mesh, "faces", ())))
        return mesh
    except Exception as error:  # the readers raise whatever the damage happens to trigger
        raise ValueError(" ".join(str(error).split())[:120] or type(error).__name__) from error


def read_geometry_file(source: Path, process: bool = False) -> Any:
    """Read a file whose ending is its format, or that is packed; see :func:`read_geometry`.

    Raises:
        OSError: it cannot be read.
        ValueError: it holds no shape that can be read.
    """
    shape = shape_in(source)
    return read_geometry(shape.content, shape.kind, process)


def _check_arrays(vertices: NDArray[Any], faces: NDArray[Any]) -> None:
    """Refuse vertices that are not points, and faces that refer to missing vertices."""
    if vertices.size and (vertices.ndim != 2 or vertices.shape[1] != 3):
        raise ValueError("its vertices do not have three coordinates")
    if faces.size and (faces.ndim != 2 or faces.shape[1] != 3 or faces.min() < 0 or faces.max() >= len(vertices)):
        raise ValueError("its faces refer to vertices that it does not hold")


def _one(scene: trimesh.Scene) -> trimesh.Trimesh:
    import trimesh

    faces = {name: len(getattr(item, "faces", ())) for name, item in scene.geometry.items()}
    total = sum(faces[scene.graph[node][1]] for node in scene.graph.nodes_geometry)
    if total > MOST_TRIANGLES:
        raise ValueError(f"it has {total} triangles; at most {MOST_TRIANGLES} are read")
    return scene.to_mesh() if scene.geometry else trimesh.Trimesh()
