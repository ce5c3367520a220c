from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from pipeline.records.errors import UserError
from pipeline.records.objects import PreparedObject, read_prepared_object, write_prepared_object


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    mesh = trimesh.creation.box([0.04] * 3)
    vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
    cube = PreparedObject(
        name="cube",
        vertices=vertices,
        faces=faces,
        parts=((vertices, faces),),
        distance=np.zeros((4, 4, 4), np.float32),
        distance_origin=np.zeros(3),
        distance_spacing=0.01,
        surface_points=vertices,
        surface_normals=vertices,
        mass=0.1,
        inertia=np.eye(3),
        volume=0.04**3,
        extents=np.full(3, 0.04),
        provenance={},
    )
    write_prepared_object(tmp_path / "cube", cube)
    return tmp_path / "cube"


@pytest.mark.parametrize("file", ["mesh.ply", "parts/00.ply", "distance.npy", "surface.npy", "object.json"])
@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9])
def test_a_truncated_file_is_one_sentence(folder: Path, file: str, share: float) -> None:
    content = (folder / file).read_bytes()
    (folder / file).write_bytes(content[: int(share * len(content))])
    with pytest.raises(UserError, match=r"damaged.*dvc repro prepare@cube"):
        read_prepared_object(folder)


def test_a_missing_number_is_one_sentence(folder: Path) -> None:
    (folder / "object.json").write_text('{"part_count": 1}\n')
    with pytest.raises(UserError, match=r"damaged.*dvc repro prepare@cube"):
        read_prepared_object(folder)
