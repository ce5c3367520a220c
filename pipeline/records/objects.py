"""The prepared object: one mesh in one canonical frame, and everything derived from it.

Layout of ``data/prepare/<object>/``::

    mesh.ply           watertight solid
    parts/00.ply ...   convex parts, the collision shape of physics
    distance.npy       (nx, ny, nz) float32 signed distance, positive outside, m
    surface.npy        (n, 6) float32 points and outward unit normals, in farthest-point order
    object.json        the numbers of :class:`PreparedObject` and the provenance
    picture.png        what the object looks like

Object frame: origin at the centre of mass (uniform density), canonical resting orientation, z up, metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.geometry import read_geometry_file
from pipeline.records.texts import parse_json
from pipeline.records.writing import whole_folder, write_json


@dataclass(frozen=True)
class PreparedObject:
    """One object ready for synthesis, physics and pictures; all arrays in the object frame, SI units."""

    name: str
    vertices: NDArray[np.float64]  # (V, 3)
    faces: NDArray[np.int64]  # (F, 3), counter-clockwise from outside
    parts: tuple[tuple[NDArray[np.float64], NDArray[np.int64]], ...]  # convex (vertices, faces)
    distance: NDArray[np.float32]  # (nx, ny, nz), positive outside
    distance_origin: NDArray[np.float64]  # (3,), position of cell centre [0, 0, 0]
    distance_spacing: float  # m between neighbouring cell centres
    surface_points: NDArray[np.float64]  # (n, 3)
    surface_normals: NDArray[np.float64]  # (n, 3)
    mass: float  # kg
    inertia: NDArray[np.float64]  # (3, 3), kg m2 about the origin
    volume: float  # m3
    extents: NDArray[np.float64]  # (3,), axis-aligned, m
    provenance: dict[str, Any]  # source, licence, stable poses, repairs

    @property
    def bottom(self) -> float:
        """Lowest z of the object, m (negative)."""
        return float(self.vertices[:, 2].min())


def write_mesh(target: Path, vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> None:
    """Write a binary PLY; vertices must already be float32 values, as PLY holds no more."""
    corners = np.empty(len(faces), dtype=[("count", "u1"), ("index", "<i4", 3)])
    corners["count"], corners["index"] = 3, faces
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty float x\n"
        f"property float y\nproperty float z\nelement face {len(faces)}\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    target.write_bytes(header.encode() + vertices.astype("<f4").tobytes() + corners.tobytes())


def write_prepared_object(folder: Path, prepared: PreparedObject, picture: bytes = b"") -> None:
    """Write one prepared object as a whole folder; the same object gives the same bytes.

    Args:
        picture: the PNG that shows it.

    Raises:
        UserError: the folder cannot be written to.
    """
    with whole_folder(folder) as temporary:
        write_mesh(temporary / "mesh.ply", prepared.vertices, prepared.faces)
        (temporary / "parts").mkdir()
        for index, (vertices, faces) in enumerate(prepared.parts):
            write_mesh(temporary / "parts" / f"{index:02d}.ply", vertices, faces)
        np.save(temporary / "distance.npy", prepared.distance.astype(np.float32), allow_pickle=False)
        surface = np.concatenate([prepared.surface_points, prepared.surface_normals], axis=1)
        np.save(temporary / "surface.npy", surface.astype(np.float32), allow_pickle=False)
        write_json(
            temporary / "object.json",
            {
                "part_count": len(prepared.parts),
                "distance_origin": prepared.distance_origin.tolist(),
                "distance_spacing": prepared.distance_spacing,
                "mass": prepared.mass,
                "inertia": prepared.inertia.tolist(),
                "volume": prepared.volume,
                "extents": prepared.extents.tolist(),
                "provenance": prepared.provenance,
            },
        )
        if picture:
            (temporary / "picture.png").write_bytes(picture)


def load_prepared_object(name: str) -> PreparedObject:
    """Load ``data/prepare/<name>``.

    Raises:
        UserError: the folder is missing or damaged.
    """
    return read_prepared_object(paths.prepared_folder(name))


def read_prepared_object(folder: Path) -> PreparedObject:
    """Read one prepared object from its folder; see :func:`load_prepared_object`."""
    name = folder.name
    mend = f"delete the folder and run `dvc repro prepare@{name}` (`prepare-mesh@{name}` for a mesh of your own)"
    try:
        facts = parse_json((folder / "object.json").read_text())
        mesh = read_geometry_file(folder / "mesh.ply")
        parts = [read_geometry_file(path) for path in sorted((folder / "parts").glob("*.ply"))]
        surface = np.load(folder / "surface.npy", allow_pickle=False).astype(np.float64)
        distance = np.load(folder / "distance.npy", allow_pickle=False)
        if len(parts) != facts["part_count"]:
            raise ValueError("parts are missing")
        return PreparedObject(
            name=name,
            vertices=np.asarray(mesh.vertices, dtype=np.float64),
            faces=np.asarray(mesh.faces, dtype=np.int64),
            parts=tuple((np.asarray(p.vertices, np.float64), np.asarray(p.faces, np.int64)) for p in parts),
            distance=distance,
            distance_origin=np.asarray(facts["distance_origin"], dtype=np.float64),
            distance_spacing=float(facts["distance_spacing"]),
            surface_points=surface[:, :3],
            surface_normals=surface[:, 3:],
            mass=float(facts["mass"]),
            inertia=np.asarray(facts["inertia"], dtype=np.float64),
            volume=float(facts["volume"]),
            extents=np.asarray(facts["extents"], dtype=np.float64),
            provenance=facts["provenance"],
        )
    except FileNotFoundError as error:
        raise UserError(f"{error.filename or folder} is missing; {mend}.") from error
    except (ValueError, TypeError, LookupError, AttributeError, EOFError, OSError, MemoryError) as error:
        raise UserError(f"{folder} is damaged ({error}); {mend}.") from error
