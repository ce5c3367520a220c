"""Nothing that a file says is ever executed: no loader that could is called, and crafted files do nothing."""

from __future__ import annotations

import ast
import json
import os
import pickle
import struct
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.trust.damage import valid_or_one_sentence
from tests.trust.test_fuzz_texts import capture

# Whoever loads with one of these lets the file run code. Names as called, whatever the module is imported as.
CAN_EXECUTE = {
    *("pickle.load", "pickle.loads", "pickle.Unpickler", "cloudpickle.load", "cloudpickle.loads", "dill.load"),
    *("dill.loads", "joblib.load", "torch.load", "torch.jit.load", "torch.hub.load", "marshal.load", "marshal.loads"),
    *("shelve.open", "pandas.read_pickle", "numpy.load", "numpy.fromregex", "yaml.load", "yaml.load_all"),
    *("yaml.unsafe_load", "yaml.unsafe_load_all", "yaml.full_load", "yaml.full_load_all", "eval", "exec", "compile"),
    *("os.system", "os.popen", "subprocess.getoutput", "subprocess.getstatusoutput", "runpy.run_path", "__import__"),
    *("importlib.import_module", "pandas.eval", "pandas.read_hdf", "trimesh.load", "trimesh.load_mesh"),
    *("trimesh.load_scene", "trimesh.load_path", "trimesh.load_remote"),
}
# What is called all the same, and why that executes nothing from a file that somebody else could have made.
ALLOWED = {
    (
        "pipeline/compute/cluster.py",
        "pickle.loads",
    ): "what a stage and the Dask workers that it is told to use send each other",
    ("pipeline/compute/executor.py", "pickle.loads"): "what it has pickled itself, to see whether it can be sent",
    ("pipeline/compute/guard.py", "pickle.loads"): "the answer of its own child, through a pipe",
    ("pipeline/compute/guard_server.py", "pickle.loads"): "what the process that started it asks for, through a pipe",
    ("pipeline/compute/shared.py", "pickle.load"): "a folder that this very run made for its own workers, mode 0700",
    ("pipeline/stages/unfinished.py", "pickle.loads"): "results that this very stage kept in data/.unfinished",
    ("pipeline/stages/earlier.py", "yaml.load"): "with the safe loader",
    ("pipeline/train/training.py", "torch.load"): "weights_only: tensors and plain data; see the test below",
    ("pipeline/records/texts.py", "yaml.load"): "always with the safe loader or a class derived from it",
    ("pipeline/records/geometry.py", "trimesh.load"): "without a resolver: nothing but the bytes that are given",
    ("pipeline/hand/surface.py", "trimesh.load_mesh"): "the robot's description in the installed package",
    ("pipeline/hand/meshes.py", "trimesh.load_scene"): "meshes that the description of the user's own hand names",
    ("pipeline/pictures/robot.py", "trimesh.load"): "the robot's description in the installed package",
}


def calls(source: Path) -> list[tuple[str, ast.Call]]:
    """Return the full names of all functions called in a file, imports resolved."""
    tree = ast.parse(source.read_text())
    names = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {
                item.asname or item.name.split(".")[0]: item.name if item.asname else item.name.split(".")[0]
                for item in node.names
            }
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names |= {item.asname or item.name: f"{node.module}.{item.name}" for item in node.names}
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            parts, target = [], node.func
            while isinstance(target, ast.Attribute):
                parts.append(target.attr)
                target = target.value
            if isinstance(target, ast.Name):
                found.append((".".join([names.get(target.id, target.id), *reversed(parts)]), node))
    return found


def keyword(call: ast.Call, name: str) -> object:
    """Return the literal value of a keyword argument."""
    return next(
        (item.value.value for item in call.keywords if item.arg == name and isinstance(item.value, ast.Constant)), None
    )


def test_no_loader_that_can_execute_is_called(repository):
    seen = set()
    for source in sorted(path for room in ("pipeline", "tools") for path in (repository / room).rglob("*.py")):
        name = str(source.relative_to(repository))
        for called, call in calls(source):
            if called == "numpy.load" and keyword(call, "allow_pickle") is False:
                continue
            if called in CAN_EXECUTE:
                assert (name, called) in ALLOWED, f"{name}:{call.lineno} calls {called}"
                seen.add((name, called))
            assert keyword(call, "allow_pickle") is not True and keyword(call, "shell") is not True, name
            if called == "torch.load":
                assert keyword(call, "weights_only") is True, name
    assert seen == set(ALLOWED), "the list of exceptions names what is no longer called"


class Bomb:
    """Its pickle creates a file when it is loaded."""

    def __init__(self, canary: Path) -> None:
        self.canary = canary

    def __reduce__(self):
        return os.mknod, (str(self.canary),)


@pytest.fixture
def canary(tmp_path) -> Path:
    """A file that exists once something was executed."""
    return tmp_path / "executed"


@pytest.fixture
def bomb(canary) -> bytes:
    """A pickle that would; shown to work."""
    content = pickle.dumps(Bomb(canary))
    pickle.loads(content)
    assert canary.exists()
    canary.unlink()
    return content


def test_arrays_of_objects_are_refused(tmp_path, canary):
    from pipeline.propose.own_objects import load_own_object
    from pipeline.reconstruct.normal_maps import read_normals

    source = tmp_path / "cloud.npy"
    np.save(source, np.array([[Bomb(canary)] * 3] * 80, object), allow_pickle=True)
    for read in (load_own_object, read_normals):
        assert valid_or_one_sentence(lambda read=read: read(source))
    assert not canary.exists()


@pytest.mark.parametrize("kind", ["pickle", "torch"])
def test_a_checkpoint_that_is_a_pickle_is_refused(tmp_path, canary, bomb, kind):
    import torch

    from pipeline.model.checkpoint import read_checkpoint

    (tmp_path / "model.json").write_text('{"format": 1}')
    weights = tmp_path / "model.safetensors"
    weights.write_bytes(bomb) if kind == "pickle" else torch.save(Bomb(canary), weights)
    assert "damaged" in valid_or_one_sentence(lambda: read_checkpoint(tmp_path))
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    with pytest.raises(SafetensorError):
        load_file(weights)
    assert not canary.exists()


def test_the_state_of_a_training_executes_nothing(tmp_path, canary):
    import torch

    from pipeline.train.training import _resume

    state = tmp_path / "unfinished.pt"
    torch.save({"identity": Bomb(canary)}, state)
    assert _resume(state, "", None, None, None) == (0, [])
    assert not canary.exists()


ORDERS = ["!!python/object/apply:os.mknod ['{}']", "!!python/object/new:os.mknod ['{}']", "!!python/name:os.mknod"]


@pytest.mark.parametrize("order", ORDERS)
def test_yaml_makes_no_objects(tmp_path, canary, order):
    from pipeline.records.captures import read_capture
    from pipeline.records.parameters import read_parameters
    from pipeline.share.project import WorkingFolder, objects_of

    text = f"styles: {order.format(canary)}\n"
    (tmp_path / "params.yaml").write_text(text)
    folder = capture(tmp_path / "capture")
    (folder / "tags.yaml").write_text(text)
    assert "YAML" in valid_or_one_sentence(lambda: read_parameters(tmp_path / "params.yaml"))
    assert valid_or_one_sentence(lambda: objects_of(WorkingFolder(tmp_path)))
    assert "YAML" in valid_or_one_sentence(lambda: read_capture(folder))
    assert not canary.exists()


LAUGHS = "a: &a [1, 1]\n"
for before, after in pairwise("abcdefghi"):
    LAUGHS += f"{after}: &{after} [{', '.join([f'*{before}'] * 9)}]\n"


@pytest.mark.parametrize("text", [LAUGHS, "seed: &a [*a]\n", "seed: " + "[" * 10**6, "seed: " + "9" * 5000])
def test_yaml_without_end_is_refused_at_once(tmp_path, text):
    from pipeline.records.parameters import read_parameters
    from pipeline.share.project import WorkingFolder, objects_of

    (tmp_path / "params.yaml").write_text(text)
    assert "is not valid YAML" in valid_or_one_sentence(lambda: read_parameters(tmp_path / "params.yaml"))
    assert valid_or_one_sentence(lambda: objects_of(WorkingFolder(tmp_path)))


def test_deeply_nested_json_is_refused(tmp_path):
    from pipeline.model.checkpoint import read_checkpoint
    from pipeline.records.captures import read_truth

    deep = "[" * 20000
    (tmp_path / "model.json").write_text(deep)
    assert "damaged" in valid_or_one_sentence(lambda: read_checkpoint(tmp_path))
    folder = capture(tmp_path / "capture")
    (folder / "gt/cameras.json").write_text(deep)
    assert "damaged" in valid_or_one_sentence(lambda: read_truth(folder))


def test_a_table_with_objects_executes_nothing(tmp_path, canary, bomb):
    """Pickles in a column stay bytes, and so do those in the file's own description of an extension type."""
    from pipeline.records.tables import MERGED, read_table
    from pipeline.share.project import WorkingFolder, read_columns

    source = tmp_path / "table.parquet"
    field = pa.field(
        "q",
        pa.binary(),
        metadata={b"ARROW:extension:name": b"arrow.py_extension_type", b"ARROW:extension:metadata": bomb},
    )
    pq.write_table(pa.Table.from_arrays([pa.array([bomb])], schema=pa.schema([field])), source)
    assert valid_or_one_sentence(lambda: read_table(source, MERGED, "merge@cube"))
    assert valid_or_one_sentence(lambda: read_columns(WorkingFolder(tmp_path), Path("table.parquet"), MERGED, ""))
    assert not canary.exists()


def test_a_table_that_claims_more_than_memory_holds_is_refused(tmp_path):
    from pipeline.records import tables
    from pipeline.records.tables import MERGED, read_table

    source = tmp_path / "table.parquet"
    nothing = pa.table({"a": pa.nulls(20_000_000, pa.int8())})
    pq.write_table(nothing, source, row_group_size=20_000_000)
    assert source.stat().st_size < 100_000  # for 20 million values
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tables, "MOST_VALUES", 10_000_000)
        patch.setattr(pq, "read_table", None)
        assert "damaged" in valid_or_one_sentence(lambda: read_table(source, MERGED, "merge@cube"))


def glb(header: dict) -> bytes:
    """A binary glTF without data."""
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<4sIIII", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A) + text


def test_a_mesh_leads_to_no_other_file(tmp_path):
    """A pipe that would be read from for ever stands for everything that a name could lead to."""
    from pipeline.prepare.sources import load_triangles
    from pipeline.propose.own_objects import load_own_object

    os.mkfifo(tmp_path / "pipe")
    triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n"
    (tmp_path / "painted.mtl").write_text("newmtl m\nmap_Kd pipe\n")
    (tmp_path / "painted.obj").write_text(f"mtllib painted.mtl\n{triangle}")
    (tmp_path / "piped.obj").write_text(f"mtllib pipe\n{triangle}")
    (tmp_path / "piped.glb").write_bytes(
        glb({"asset": {"version": "2.0"}, "buffers": [{"byteLength": 9, "uri": "pipe"}]})
    )
    ply = "ply\nformat ascii 1.0\ncomment TextureFile pipe\nelement vertex 3\nproperty float x\nproperty float y\n"
    ply += "property float z\nproperty float s\nproperty float t\nelement face 1\n"
    ply += "property list uchar int vertex_indices\nend_header\n0 0 0 0 0\n1 0 0 0 0\n0 1 0 0 0\n3 0 1 2\n"
    (tmp_path / "painted.ply").write_text(ply)
    for name in ("painted.obj", "piped.obj", "painted.ply", "piped.glb"):
        valid_or_one_sentence(lambda name=name: load_triangles(tmp_path / name, "meshes.box"))
        valid_or_one_sentence(lambda name=name: load_own_object(tmp_path / name))
    vertices, _ = load_triangles(tmp_path / "painted.obj", "meshes.box")
    assert len(vertices) == 3


@pytest.mark.parametrize("count", [10**12, 10**9])
def test_a_mesh_that_claims_what_it_does_not_hold_is_refused(tmp_path, count):
    from pipeline.prepare.sources import load_triangles

    accessors = [{"componentType": 5126, "type": "VEC3", "count": count}]
    mesh = {"primitives": [{"attributes": {"POSITION": 0}}]}
    scene = {
        "asset": {"version": "2.0"},
        "accessors": accessors,
        "meshes": [mesh],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    (tmp_path / "a.glb").write_bytes(glb(scene))
    (tmp_path / "a.stl").write_bytes(b" " * 80 + struct.pack("<I", count % 2**32))
    (tmp_path / "a.off").write_text(f"OFF\n{count} {count} 0\n0 0 0\n")
    for kind in ("ascii", "binary_little_endian"):
        (tmp_path / f"{kind}.ply").write_text(
            f"ply\nformat {kind} 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float z\n"
            f"element face {count}\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n"
        )
    for name in ("a.glb", "a.stl", "a.off", "ascii.ply", "binary_little_endian.ply"):
        said = valid_or_one_sentence(lambda name=name: load_triangles(tmp_path / name, "meshes.box"))
        assert "holds no triangle mesh" in said or "is a point cloud" in said, name


def test_a_scene_that_repeats_itself_without_end_is_refused(tmp_path):
    """Thirty nodes, each the child of the one before twice: 2 ** 30 meshes."""
    from pipeline.prepare.sources import load_triangles

    nodes = [{"children": [index + 1, index + 1]} for index in range(30)] + [{"mesh": 0}]
    mesh = {"primitives": [{"attributes": {"POSITION": 0}}]}
    accessors = [{"componentType": 5126, "type": "VEC3", "count": 0, "bufferView": 0}]
    scene = {
        "asset": {"version": "2.0"},
        "nodes": nodes,
        "meshes": [mesh],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
        "accessors": accessors,
        "bufferViews": [{"buffer": 0, "byteLength": 0}],
        "buffers": [{"byteLength": 0}],
    }
    (tmp_path / "a.glb").write_bytes(glb(scene))
    assert valid_or_one_sentence(lambda: load_triangles(tmp_path / "a.glb", "meshes.box"))


@pytest.mark.parametrize("name", ["mesh.zip", "mesh.gltf", "mesh.dae", "mesh.3mf", "mesh.tar.gz"])
def test_what_is_no_archive_and_no_scene_is_refused(tmp_path, name):
    from pipeline.prepare.sources import load_triangles
    from pipeline.propose.own_objects import load_own_object

    source = tmp_path / name
    source.write_bytes(b"PK\x03\x04")
    assert valid_or_one_sentence(lambda: load_triangles(source, "meshes.box"))
    assert valid_or_one_sentence(lambda: load_own_object(source))


def png(width: int, height: int) -> bytes:
    """A picture of a few bytes that unpacks to any size."""
    import zlib

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    pixels = zlib.compress(b"\0" * 1_000_000)
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")


def test_a_picture_that_unpacks_to_any_size_is_refused(tmp_path):
    from pipeline.reconstruct.normal_maps import read_normals
    from pipeline.reconstruct.photos import read_grey

    source = tmp_path / "a.png"
    source.write_bytes(png(60000, 60000))
    assert "too large" in valid_or_one_sentence(lambda: read_grey(source))
    assert valid_or_one_sentence(lambda: read_normals(source))


def test_an_array_that_claims_more_than_it_holds_is_refused(tmp_path):
    from pipeline.propose.own_objects import load_own_object
    from pipeline.reconstruct.normal_maps import read_normals

    source = tmp_path / "a.npy"
    text = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 3), }"
    text += b" " * (-(len(text) + 11) % 64) + b"\n"
    source.write_bytes(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + b"\0" * 96)
    assert valid_or_one_sentence(lambda: load_own_object(source))
    assert valid_or_one_sentence(lambda: read_normals(source))
