"""Damaged meshes, clouds, pictures and tables, through every reader of files that a user is handed."""

from __future__ import annotations

import base64
import io
import json
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from hypothesis import given

from pipeline.records.flat import PAIR_GRASPS, read_flat
from pipeline.records.gltf import split
from pipeline.records.tables import MERGED, read_table, write_table
from tests.evaluate.conftest import GROUPS, HAND
from tests.pairs import PAIR
from tests.propose.test_clouds import pcd
from tests.records.test_shapes_of_strangers import collada, threemf
from tests.trust.damage import damaged, edits, examples, valid_or_one_sentence


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("files")


@pytest.fixture(scope="module")
def meshes() -> dict[str, bytes]:
    """A textured box in every format."""
    import trimesh
    from PIL import Image

    box = trimesh.creation.box((0.04, 0.05, 0.06))
    found = {kind: box.export(file_type=kind) for kind in ("obj", "stl", "stl_ascii", "ply", "off", "glb")}
    painted = box.copy()
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.new("RGB", (4, 4)))
    painted.visual = trimesh.visual.TextureVisuals(uv=np.zeros((8, 2)), material=material)
    found["painted.glb"] = trimesh.Scene([painted, box]).export(file_type="glb")
    found["ascii.ply"] = box.export(file_type="ply", encoding="ascii")
    found["stl_ascii.stl"] = found.pop("stl_ascii")
    found["cloud.npy"] = _npy(np.asarray(box.vertices))
    found["cloud.pcd"] = pcd(np.repeat(np.asarray(box.vertices), 9, axis=0), "ascii")
    found["box.3mf"], found["box.dae"] = threemf(), collada()
    header, binary = split(found["glb"])
    inline = "data:application/octet-stream;base64," + base64.b64encode(binary).decode()
    found["box.gltf"] = json.dumps(header | {"buffers": [{"byteLength": len(binary), "uri": inline}]})
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w") as archive:
        archive.writestr("box.off", found["off"])
    found["box.zip"] = target.getvalue()
    return {
        name if "." in name else f"box.{name}": content.encode() if isinstance(content, str) else content
        for name, content in found.items()
    }


def _npy(array: np.ndarray) -> bytes:
    target = io.BytesIO()
    np.save(target, array)
    return target.getvalue()


MESHES = ["box.obj", "box.stl", "stl_ascii.stl", "box.ply", "ascii.ply", "box.off", "box.glb", "painted.glb"]
MESHES += ["box.gltf", "box.3mf", "box.dae", "box.zip"]


@pytest.mark.slow
@pytest.mark.parametrize("name", [*MESHES, "cloud.npy", "cloud.pcd"])
@examples(5)
@given(changes=edits)
def test_meshes(place, meshes, name, changes):
    from pipeline.prepare.sources import load_triangles
    from pipeline.propose.own_objects import load_own_object

    source = place / name
    source.write_bytes(damaged(meshes[name], changes))
    if not name.startswith("cloud."):
        valid_or_one_sentence(lambda: load_triangles(source, "meshes.box"))
    valid_or_one_sentence(lambda: load_own_object(source))
    source.unlink()
    assert list(place.iterdir()) == []


@pytest.mark.parametrize(
    "text", ["v 1\nv 2\nv 3\nf 1 2 3\n", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "v 0 0 0\nf 1 1 -7\n"]
)
def test_an_obj_of_no_points_or_of_foreign_corners(place, text):
    from pipeline.prepare.sources import load_triangles
    from pipeline.propose.own_objects import load_own_object

    source = place / "a.obj"
    source.write_text(text)
    assert valid_or_one_sentence(lambda: load_triangles(source, "meshes.box"))
    assert valid_or_one_sentence(lambda: load_own_object(source))
    source.unlink()


@examples(12)
@given(changes=edits)
def test_true_surfaces_of_a_capture(place, meshes, changes):
    from pipeline.reconstruct.reconstruction import true_surfaces
    from pipeline.records.captures import Truth

    source = place / "box.ply"
    source.write_bytes(damaged(meshes["ascii.ply" if len(changes) % 2 else "box.ply"], changes))
    valid_or_one_sentence(lambda: true_surfaces(Truth({"box": source}, False, {})))
    source.unlink()


def _picture(kind: str) -> bytes:
    from PIL import Image

    target = io.BytesIO()
    pixels = np.arange(80 * 96 * 3, dtype=np.uint32).reshape(80, 96, 3) % 251
    picture = Image.fromarray(pixels.astype(np.uint8))
    exif = Image.Exif()
    exif[274] = 6
    picture.save(target, kind, exif=exif)
    return target.getvalue()


@pytest.fixture(scope="module")
def pictures() -> dict[str, bytes]:
    normals = np.zeros((80, 96, 3), np.float32) + [0, 0, -1]
    return {"a.jpg": _picture("JPEG"), "a.png": _picture("PNG"), "a.npy": _npy(normals.astype(np.float32))}


@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.npy"])
@examples(12)
@given(changes=edits)
def test_pictures(place, pictures, name, changes):
    from pipeline.reconstruct.normal_maps import read_normals
    from pipeline.reconstruct.photos import read_colours, read_grey

    source = place / name
    source.write_bytes(damaged(pictures[name], changes))
    readers = [read_normals] if name == "a.npy" else [read_grey, read_colours, read_normals]
    for reader in readers:
        valid_or_one_sentence(lambda reader=reader: reader(source))
    source.unlink()


def merged_rows(count: int = 2) -> pd.DataFrame:
    """Made-up grasps with everything set."""
    vector, names = [1.0, *[0.0] * 15], ["cube", "soup_can"]
    own = {"objects": names, "fingers": ["", ""], "gravity_drift": vector, "rejected_by": ""}
    rows = []
    for number in range(count):
        row = {}
        for field in MERGED:
            kind = field.type
            part = kind.value_type if pa.types.is_list(kind) else kind
            value = vector[: part.list_size] if pa.types.is_fixed_size_list(part) else number
            row[field.name] = own.get(field.name, [value] * 2 if pa.types.is_list(kind) else value)
        rows.append(row)
    return pd.DataFrame(rows)


@pytest.fixture(scope="module")
def merged_table(tmp_path_factory) -> bytes:
    target = tmp_path_factory.mktemp("merged") / "table.parquet"
    write_table(target, merged_rows(), MERGED)
    return target.read_bytes()


@examples(20)
@given(changes=edits)
def test_tables_of_grasps(place, merged_table, changes):
    from pipeline.evaluate.grasps import accepted_grasps
    from pipeline.model.representation import grasps_of
    from pipeline.plan.__main__ import Choice, _grasp
    from pipeline.share.project import WorkingFolder, read_columns

    source = place / "table.parquet"
    source.write_bytes(damaged(merged_table, changes))
    folder = WorkingFolder(place)
    valid_or_one_sentence(lambda: accepted_grasps(read_table(source, MERGED, "merge@cube"), HAND, GROUPS, 0.002))
    valid_or_one_sentence(lambda: grasps_of(read_flat(source, PAIR_GRASPS, "merge@cube")))
    valid_or_one_sentence(lambda: read_columns(folder, Path("table.parquet"), MERGED, "merge@cube"))
    valid_or_one_sentence(lambda: _grasp(Choice(source), HAND, PAIR))
    source.unlink()


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> bytes:
    from pipeline.records.recordings import About, Recording, write_recording

    target = tmp_path_factory.mktemp("recording") / "a.parquet"
    poses = np.zeros((2, 3, 7))
    about = About("synthesized/a/b/0", ("a", "b"), "success", 0.05)
    write_recording(target, Recording(about, np.arange(3.0), ["x"] * 3, np.zeros((3, 23)), poses))
    return target.read_bytes()


@examples(20)
@given(changes=edits)
def test_recordings(place, recording, changes):
    from pipeline.records.recordings import read_recording

    source = place / "recording.parquet"
    source.write_bytes(damaged(recording, changes))
    valid_or_one_sentence(lambda: read_recording(source))
    source.unlink()


Q, X, DOWN = [0.0] * 16, [1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]
WRONG = {
    "merged_id": [None],
    "q": [[float("nan")] * 16, [float("inf")] * 16],
    "squeeze_q": [[1e400] * 16],
    "open_q": [None, [], [Q], [[None] * 16, Q], [Q, None]],
    "approach_directions": [None, [X], [X, [float("nan")] * 3]],
    "approach_lengths": [None, [None]],
    "positions_hand_object": [[[float("inf"), 0.0, 0.0], X], [X]],
    "quaternions_hand_object": [[DOWN, [0.0] * 4], [DOWN, [2.0, 0.0, 0.0, 0.0]]],
    "objects": [None, [], ["cube"], [None, "cube"], ["../../../etc", "cube"], ["a/b", "cube"], ["", "cube"]],
}


@pytest.mark.parametrize(("column", "value"), [(name, value) for name, values in WRONG.items() for value in values])
def test_a_grasp_from_elsewhere_that_is_none_is_refused(place, column, value):
    """The columns are right, and what is in them is not."""
    from pipeline.plan.__main__ import Choice, _grasp

    source = place / "table.parquet"
    rows = merged_rows()
    rows[column] = pd.Series([value] * len(rows), dtype=object)
    try:
        write_table(source, rows, MERGED)
    except pa.ArrowInvalid:
        pytest.skip("no such table can be written")
    assert valid_or_one_sentence(lambda: _grasp(Choice(source), HAND, PAIR))
    source.unlink()
