"""Normals by networks that are made here: they read them from the colours of photos that show normals."""

import sys

import numpy as np
import pytest
import yaml
from PIL import Image

from pipeline.reconstruct.normal_maps import read_normals
from pipeline.records.errors import UserError
from tools.captures import main

SIZE = (120, 80)
SCALES = {"zero-one": (2.0, -1.0), "minus-one-one": (1.0, 0.0)}  # what makes normals of coded colours


def truth():
    """Return the normals (h, w, 3) of a paraboloid that bulges towards the camera: x right, y down, z forward."""
    x, y = np.meshgrid((np.arange(SIZE[0]) - 60) / 60, (np.arange(SIZE[1]) - 30) / 60)
    normals = np.stack([x, y, -np.ones_like(x)], axis=-1)
    return normals / np.linalg.norm(normals, axis=2, keepdims=True)


def network(path, scale="zero-one", shape=(1, 3, 64, 64), channels=3):
    """Write a network that returns its input, or its first channels, times and plus a number."""
    onnx = pytest.importorskip("onnx")
    from onnx import TensorProto, helper, numpy_helper

    factor, shift = SCALES[scale]
    nodes = [
        helper.make_node("Mul", ["photo", "factor"], ["more"]),
        helper.make_node("Add", ["more", "shift"], ["all"]),
        helper.make_node("Slice", ["all", "from", "to", "axis"], ["normals"]),
    ]
    constants = {"factor": np.float32(factor), "shift": np.float32(shift)}
    constants |= {"from": np.array([0]), "to": np.array([channels]), "axis": np.array([1])}
    graph = helper.make_graph(
        nodes,
        "coded",
        [helper.make_tensor_value_info("photo", TensorProto.FLOAT, list(shape))],
        [helper.make_tensor_value_info("normals", TensorProto.FLOAT, [None] * 4)],
        [numpy_helper.from_array(np.asarray(value), name) for name, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(model, path)
    return path


@pytest.fixture
def folder(tmp_path):
    """A capture whose photos show normals as x right, y up, z toward the camera, coded as colours."""
    (tmp_path / "images").mkdir()
    coded = truth() * [1, -1, -1]
    for at in range(3):
        pixels = ((coded + 1) / 2 * 255).round().astype(np.uint8)
        Image.fromarray(pixels).save(tmp_path / f"images/photo_{at}.png")
    (tmp_path / "tags.yaml").write_text(yaml.safe_dump({"family": "aruco_4x4_50", "size": 0.04, "tags": "anywhere"}))
    scene = {"objects": {"ball": {"position": [0, 0], "box": [0.1, 0.1, 0.1]}}}
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(scene))
    return tmp_path


def run(folder, model, *more):
    return main(["normals", str(folder), "--model", str(model), *more])


@pytest.mark.parametrize(
    ("scale", "shape"),
    [
        ("zero-one", (1, 3, 64, 64)),
        ("minus-one-one", (1, 3, "height", "width")),
        ("zero-one", ("batch", 160, 240, 3)),
    ],
)
def test_normals_come_in_the_camera_frame_and_as_large_as_the_photo(folder, capsys, scale, shape):
    pytest.importorskip("onnxruntime")
    model = network(folder / "model.onnx", scale, shape, 3 if shape[1] == 3 else 160)
    assert run(folder, model, "--axes", "right,up,toward", "--scale", scale) == 0, capsys.readouterr().err
    for at in range(3):
        found = read_normals(folder / f"normals/photo_{at}.npy")
        assert found.shape == (80, 120, 3)
        assert np.linalg.norm(found, axis=2) == pytest.approx(1, abs=2e-3)
        angle = np.degrees(np.arccos(np.clip((found * truth()).sum(axis=2), -1, 1)))
        assert np.median(angle) < 1.0 and angle.max() < 4.0
    assert run(folder, model, "--axes", "right,up,toward", "--scale", scale) == 2
    assert "--force" in capsys.readouterr().err


def test_what_cannot_be_used_is_one_sentence(folder, capsys):
    pytest.importorskip("onnxruntime")
    (folder / "text.onnx").write_text("no network")
    cases = [
        ((folder / "missing.onnx",), "there is no network"),
        ((folder / "text.onnx",), "no ONNX network"),
        ((network(folder / "flat.onnx", shape=(1, 1, 64, 64)),), "takes one photo"),
        ((network(folder / "two.onnx", channels=2), "--axes", "right,up,toward"), "not three finite numbers"),
        ((network(folder / "coded.onnx"), "--scale", "zero-one"), "face the camera"),
        ((folder / "coded.onnx", "--axes", "right,left,up"), "is not where x, y and z point"),
    ]
    for given, words in cases:
        assert run(folder, *given) == 2, words
        said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("capture:")]
        assert len(said) == 1 and words in said[0], said
        assert not (folder / "normals").exists()


def test_without_onnxruntime_one_sentence_says_what_to_install(folder, monkeypatch):
    from pipeline.reconstruct.normal_network import convention, load_network

    (folder / "model.onnx").write_bytes(b"any")
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(UserError, match=r"onnxruntime.* \.\[normals\]|\[normals\]"):
        load_network(folder / "model.onnx", convention("imagenet", "right,down,forward"))
