"""Files of other stages: read, or refused with what, where and how to mend."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.records.errors import UserError
from pipeline.records.objects import write_mesh
from pipeline.records.reading import read_json, read_vertices

MEND = "run `dvc repro made`"
TETRAHEDRON = (
    np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0.5]]),
    np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
)


def test_an_object_is_read(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text('{"b": [1, 2.5]}')
    assert read_json(tmp_path / "a.json", MEND) == {"b": [1, 2.5]}


@pytest.mark.parametrize("content", [b"", b'{"b": ', b"[1, 2]", b"\xff\xfe", b"12"])
def test_what_is_no_object_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.json").write_bytes(content)
    with pytest.raises(UserError, match=r"a\.json is damaged .*; delete it and run `dvc repro made`\.$"):
        read_json(tmp_path / "a.json", MEND)


@pytest.mark.parametrize("read", [read_json, read_vertices])
def test_a_missing_file_is_named(tmp_path: Path, read) -> None:
    with pytest.raises(UserError, match=r"a\.ply is missing; run `dvc repro made`\.$"):
        read(tmp_path / "a.ply", MEND)


def test_vertices_keep_their_order(tmp_path: Path) -> None:
    write_mesh(tmp_path / "a.ply", *TETRAHEDRON)
    np.testing.assert_array_equal(read_vertices(tmp_path / "a.ply", MEND), TETRAHEDRON[0])


@pytest.mark.parametrize("kept", [0, 3, 60, 170, 240])
def test_a_truncated_mesh_is_refused(tmp_path: Path, kept: int) -> None:
    write_mesh(tmp_path / "a.ply", *TETRAHEDRON)
    whole = (tmp_path / "a.ply").read_bytes()
    assert len(whole) > 240
    (tmp_path / "a.ply").write_bytes(whole[:kept])
    with pytest.raises(UserError, match=r"a\.ply is damaged .*run `dvc repro made`\.$"):
        read_vertices(tmp_path / "a.ply", MEND)
