from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from pipeline.records.errors import UserError
from pipeline.records.objects import PreparedObject, read_prepared_object, write_prepared_object


@pytest.fixture
def cube() -> PreparedObject:
    rng = np.random.default_rng(3)
    mesh = trimesh.creation.box([0.04] * 3)
    vertices, faces = np.asarray(mesh.vertices, np.float32).astype(np.float64), np.asarray(mesh.faces, np.int64)
    return PreparedObject(
        name="cube",
        vertices=vertices,
        faces=faces,
        parts=((vertices, faces), (vertices[:4] / 2, faces[:1] * 0 + [0, 1, 3])),
        distance=rng.normal(size=(4, 3, 5)).astype(np.float32),
        distance_origin=rng.normal(size=3),
        distance_spacing=0.01,
        surface_points=rng.normal(size=(6, 3)).astype(np.float32).astype(np.float64),
        surface_normals=rng.normal(size=(6, 3)).astype(np.float32).astype(np.float64),
        mass=0.1,
        inertia=np.eye(3),
        volume=0.04**3,
        extents=np.full(3, 0.04),
        provenance={"source": "made up"},
    )


@pytest.fixture
def folder(tmp_path: Path, cube: PreparedObject) -> Path:
    write_prepared_object(tmp_path / "cube", cube)
    return tmp_path / "cube"


def flat(prepared: PreparedObject) -> list[tuple[str, bytes] | object]:
    """Everything that an object holds; arrays with their type and shape."""
    values = [getattr(prepared, field.name) for field in dataclasses.fields(prepared) if field.name != "parts"]
    values += [array for part in prepared.parts for array in part]
    return [(f"{v.dtype}{v.shape}", v.tobytes()) if isinstance(v, np.ndarray) else v for v in values]


def test_what_is_read_is_what_was_written_bit_for_bit(folder: Path, cube: PreparedObject) -> None:
    found = read_prepared_object(folder)
    assert [len(vertices) for vertices, _ in found.parts] == [8, 4]
    assert flat(found) == flat(cube)


def test_an_object_is_in_few_files(folder: Path) -> None:
    assert sorted(path.name for path in folder.rglob("*")) == ["mesh.ply", "object.json", "shapes.npz"]


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("part_sizes", lambda sizes: sizes[:1]),
        (
            "part_sizes",
            lambda sizes: np.stack([sizes[::-1, 0], sizes[:, 1]], axis=1),
        ),  # faces name vertices of the other part
        ("part_sizes", lambda sizes: sizes.astype(np.int64)),
        ("part_faces", lambda faces: faces + 1),
        ("part_faces", lambda faces: faces - 1),
        ("surface", lambda surface: surface[:, :3]),
        ("distance", lambda distance: distance[0]),
        ("distance", None),
    ],
)
def test_arrays_that_do_not_fit_are_one_sentence(folder: Path, name: str, change: Any) -> None:
    with np.load(folder / "shapes.npz") as file:
        arrays = dict(file)
    if change is None:
        del arrays[name]
    else:
        arrays[name] = change(arrays[name])
    np.savez(folder / "shapes.npz", **arrays)
    with pytest.raises(UserError, match=r"damaged.*dvc repro prepare`"):
        read_prepared_object(folder)


@pytest.mark.parametrize("file", ["mesh.ply", "shapes.npz", "object.json"])
def test_a_missing_file_is_named(folder: Path, file: str) -> None:
    (folder / file).unlink()
    with pytest.raises(UserError, match=f"{file} is missing.*dvc repro prepare`"):
        read_prepared_object(folder)


@pytest.mark.parametrize("file", ["mesh.ply", "shapes.npz", "object.json"])
@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9])
def test_a_truncated_file_is_one_sentence(folder: Path, file: str, share: float) -> None:
    content = (folder / file).read_bytes()
    (folder / file).write_bytes(content[: int(share * len(content))])
    with pytest.raises(UserError, match=r"damaged.*dvc repro prepare`"):
        read_prepared_object(folder)


def test_a_missing_number_is_one_sentence(folder: Path) -> None:
    (folder / "object.json").write_text('{"mass": 1}\n')
    with pytest.raises(UserError, match=r"damaged.*dvc repro prepare`"):
        read_prepared_object(folder)
