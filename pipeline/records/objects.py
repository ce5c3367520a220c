"""The prepared object: one mesh in one canonical frame, and everything derived from it.

Layout of ``data/prepare/<object>/``::

    mesh.ply      watertight solid
    shapes.npz    the arrays of :data:`SHAPES`
    object.json   the numbers of :class:`PreparedObject` and the provenance
    picture.png   what the object looks like

``shapes.npz`` is not compressed: that would make the files of scans 11 % smaller and reading them 6 times slower.

Object frame: origin at the centre of mass (uniform density), canonical resting orientation, z up, metres.
"""

from __future__ import annotations

import io
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

# Arrays of shapes.npz: type and dimensions (None: any length).
SHAPES: dict[str, tuple[str, tuple[int | None, ...]]] = {
    "part_sizes": (
        "<i4",
        (None, 2),
    ),  # vertices and faces of each convex part; parts are the collision shape of physics
    "part_vertices": ("<f4", (None, 3)),  # of all parts, one after the other
    "part_faces": ("<i4", (None, 3)),  # of all parts; indices into the vertices of the part
    "distance": ("<f4", (None, None, None)),  # signed, positive outside, m
    "surface": ("<f4", (None, 6)),  # points and outward unit normals, in farthest-point order
}


@dataclass(frozen=True, eq=False)
class PreparedObject:
    """One object ready for synthesis, physics and pictures; all arrays in the object frame, SI units.

    Equal to itself alone, so that what is made of it can be kept by it.
    """

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
        shapes = {
            "part_sizes": np.array([(len(vertices), len(faces)) for vertices, faces in prepared.parts]).reshape(-1, 2),
            "part_vertices": np.concatenate([vertices for vertices, _ in prepared.parts]),
            "part_faces": np.concatenate([faces for _, faces in prepared.parts]),
            "distance": prepared.distance,
            "surface": np.concatenate([prepared.surface_points, prepared.surface_normals], axis=1),
        }
        with (temporary / "shapes.npz").open("wb") as file:
            np.savez(file, allow_pickle=False, **{name: shapes[name].astype(SHAPES[name][0]) for name in SHAPES})
        write_json(
            temporary / "object.json",
            {
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
    mend = "delete the folder and run `dvc repro prepare`"
    try:
        facts = parse_json((folder / "object.json").read_text())
        mesh = read_geometry_file(folder / "mesh.ply")
        shapes = _read_shapes(folder / "shapes.npz")
        surface = shapes["surface"].astype(np.float64)
        return PreparedObject(
            name=folder.name,
            vertices=np.asarray(mesh.vertices, dtype=np.float64),
            faces=np.asarray(mesh.faces, dtype=np.int64),
            parts=_parts(shapes["part_sizes"], shapes["part_vertices"], shapes["part_faces"]),
            distance=shapes["distance"],
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


def _read_shapes(source: Path) -> dict[str, NDArray[Any]]:
    """Return the arrays of ``shapes.npz``.

    Raises:
        FileNotFoundError: it is missing.
        ValueError: it is damaged, or an array is missing or of another type or shape.
    """
    try:
        with np.load(io.BytesIO(source.read_bytes()), allow_pickle=False) as file:
            shapes = {name: np.asarray(file[name]) for name in SHAPES}
    except FileNotFoundError:
        raise
    except Exception as error:  # the readers of zip and npy raise whatever the damage happens to trigger
        raise ValueError(f"{source.name}: {str(error) or type(error).__name__}") from error
    for name, (kind, wanted) in SHAPES.items():
        array = shapes[name]
        lengths = zip(array.shape, wanted, strict=False)
        if array.dtype != kind or array.ndim != len(wanted) or any(w not in (None, n) for n, w in lengths):
            raise ValueError(f"{source.name}: {name} is {array.dtype} {array.shape}")
    return shapes


def _parts(
    sizes: NDArray[np.int32], vertices: NDArray[np.float32], faces: NDArray[np.int32]
) -> tuple[tuple[NDArray[np.float64], NDArray[np.int64]], ...]:
    """Split the concatenated arrays of an object into its parts, see :data:`SHAPES`.

    Raises:
        ValueError: the arrays do not belong together.
    """
    if (sizes < 1).any() or sizes.sum(axis=0).tolist() != [len(vertices), len(faces)]:
        raise ValueError("parts are missing")
    ends = np.cumsum(sizes, axis=0)[:-1]
    parts = tuple(
        (own.astype(np.float64), corners.astype(np.int64))
        for own, corners in zip(np.split(vertices, ends[:, 0]), np.split(faces, ends[:, 1]), strict=True)
    )
    if any(corners.min() < 0 or corners.max() >= len(own) for own, corners in parts):
        raise ValueError("the faces of a part name vertices that it does not have")
    return parts
