"""The stage and the tool as commands, with a tiny model, in a folder of their own."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import trimesh
import yaml

from pipeline.propose import __main__ as propose
from pipeline.records import paths
from pipeline.records.flat import PAIR_GRASPS, read_flat
from pipeline.records.objects import write_prepared_object
from pipeline.records.reconstructions import ReconstructedObject, write_reconstruction
from pipeline.records.tables import MERGED, read_table
from pipeline.sample import __main__ as sample
from pipeline.train import __main__ as stage
from tests.pairs import write_pairs
from tests.train.conftest import FIRSTS, SECONDS

CAPTURE = "shown"
TINY = {
    "encoder": {"points": 64, "clouds": 2, "centres": [16, 8, 4], "neighbours": [8, 8, 4], "widths": [8, 8, 16]},
    "denoiser": {"width": 32, "blocks": 1, "slot_width": 4},
    "optimization": {"steps": 8, "batch": 16, "record_every": 4},
    # Untrained samples pass no check; all of them are to be seen.
    "sampling": {"draws": 6, "grasps": 3, "steps": 4, "refine_iterations": 4, "check": False, "physics": False},
}


@pytest.fixture(scope="module")
def workplace(tmp_path_factory, repository: Path, objects, tables) -> Path:
    """Prepared objects, merged tables, parameters of a tiny model."""
    folder = tmp_path_factory.mktemp("train")
    values = yaml.safe_load((repository / "params.yaml").read_text())
    recipe = values["objects"]["cube"]
    values["objects"] = dict.fromkeys((*FIRSTS, *SECONDS), recipe)
    values["styles"] = {"pinch": list(FIRSTS), "side": list(SECONDS)}
    values["renderings"] = {CAPTURE: {"objects": {name: {"position": [0.0, 0.0]} for name in ("cube", "can")}}}
    values["captures"] = {CAPTURE: {"folder": str(paths.capture_folder(CAPTURE))}}
    values["reconstructed"] = {"cube": {"capture": CAPTURE, "side": ["can"]}}
    values["conditions"] |= {"pairs": [], "settings": {}}
    for part, changes in TINY.items():
        values["train"][part] |= changes
    values["compute"]["workers"] = 1
    (folder / "params.yaml").write_text(yaml.safe_dump(values))
    for prepared in objects.values():
        write_prepared_object(folder / paths.prepared_folder(prepared.name), prepared)
    found: dict[str, list[pd.DataFrame]] = {}
    for (first, _), table in tables.items():
        full = table.assign(squeeze_q=table["q"], fingers0="thumb+index", fingers1="ring+palm")
        for name in set(PAIR_GRASPS.names) - set(full.columns):
            full[name] = None
        found.setdefault(first, []).append(full)
    for first, frames in found.items():
        write_pairs(folder / paths.merged_file(first), pd.concat(frames), PAIR_GRASPS)
    return folder


@pytest.fixture(autouse=True)
def here(workplace, monkeypatch):
    monkeypatch.chdir(workplace)


@pytest.fixture(scope="module")
def model(workplace):
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(workplace)
        patch.setattr("sys.argv", ["train"])
        patch.setattr(stage, "own_fingerprint", lambda line: f"code of {line}")
        assert stage.main() == 0
    return workplace / paths.MODEL_FOLDER


def test_training_leaves_a_model_and_its_curve_and_no_state(model, monkeypatch):
    assert sorted(path.name for path in model.iterdir()) == ["history.csv", "model.json", "model.safetensors"]
    assert (model / "history.csv").read_text().startswith("step,epoch,learning_rate,training_loss,held_out_loss\n4,")
    assert not paths.TRAINING_STATE.exists()
    before = {path.name: path.read_bytes() for path in model.iterdir()}
    monkeypatch.setattr("sys.argv", ["train"])
    monkeypatch.setattr(stage, "own_fingerprint", lambda line: f"code of {line}")
    assert stage.main() == 0
    assert {path.name: path.read_bytes() for path in model.iterdir()} == before


def test_nothing_of_a_held_out_object_is_opened_in_training(workplace, tmp_path, monkeypatch):
    """The model is the same, to the byte, where those files and rows are not there."""
    models = []
    for missing in (False, True):
        folder = tmp_path / str(missing)
        shutil.copytree(workplace, folder, ignore=shutil.ignore_patterns("models"))
        values = yaml.safe_load((folder / "params.yaml").read_text())
        values["train"]["data"]["held_out_objects"] = ["ball", "slender"]
        (folder / "params.yaml").write_text(yaml.safe_dump(values))
        monkeypatch.chdir(folder)
        if missing:
            for name in ("ball", "slender"):
                shutil.rmtree(paths.prepared_folder(name))
            paths.merged_file("ball").unlink()
            rows = read_flat(paths.merged_file("cube"), PAIR_GRASPS, "merge")
            write_pairs(paths.merged_file("cube"), rows[rows["object1"] != "slender"], PAIR_GRASPS)
        monkeypatch.setattr("sys.argv", ["train"])
        monkeypatch.setattr(stage, "own_fingerprint", lambda line: f"code of {line}")
        assert stage.main() == 0
        models.append({path.name: path.read_bytes() for path in paths.MODEL_FOLDER.iterdir()})
    assert models[0] == models[1]
    assert json.loads(models[0]["model.json"])["pairs"] == [["cube", "can"]]


LEARNED = ("--source", "learned")


@pytest.mark.slow
def test_samples_of_a_pair_are_a_merged_table_that_does_not_depend_on_workers(model, workplace):
    assert sample.main([*LEARNED, "--object", "cube"]) == 0
    rows = read_flat(paths.sampled_file("learned", "cube"), PAIR_GRASPS, "sample@learned")
    assert list(dict.fromkeys(rows["object1"])) == list(SECONDS)
    for _, own in rows.groupby("object1"):
        assert own["merged_id"].tolist() == list(range(len(own)))
        accepted = own[own["rejected_by"] == ""]
        assert len(accepted) == 3
        assert all(len(row.squeeze_q) == len(row.open_q1) == 16 for row in accepted.itertuples())
    quality = json.loads(paths.sample_quality_file("learned").read_text())
    assert list(quality) == ["cube"] and set(quality["cube"]) == set(SECONDS)
    assert quality["cube"]["can"]["trained"] and quality["cube"]["can"]["drawn"] == 6
    assert quality["cube"]["can"]["ranked"]["penetration_mm_median"] >= 0
    files = (paths.sampled_file("learned", "cube"), paths.sample_quality_file("learned"))
    found = [file.read_bytes() for file in files]
    original = Path("params.yaml").read_text()
    values = yaml.safe_load(original)
    values["compute"]["workers"] = 2
    Path("params.yaml").write_text(yaml.safe_dump(values))
    assert sample.main([*LEARNED, "--object", "cube"]) == 0
    Path("params.yaml").write_text(original)
    assert [file.read_bytes() for file in files] == found


def test_samples_by_hand_stay_beside_those_of_other_objects(model, workplace):
    for first in FIRSTS:
        assert sample.main([*LEARNED, "--object", first]) == 0
    assert all(paths.sampled_file("learned", first).exists() for first in FIRSTS)
    assert set(json.loads(paths.sample_quality_file("learned").read_text())) == set(FIRSTS)


def test_reconstructed_objects_are_all_that_sampling_knows(model, workplace, objects, capsys):
    """The reconstruction is 5 mm larger than the prepared objects, which are not even there."""
    shown = {}
    for name in ("cube", "can"):
        mesh = trimesh.Trimesh(objects[name].vertices, objects[name].faces).convex_hull
        mesh.apply_scale(1 + 0.005 / mesh.extents.max())
        points, owners = trimesh.sample.sample_surface(mesh, 1024, seed=0)
        arrays = (np.asarray(points), np.asarray(mesh.face_normals[owners]), np.ones(len(points), bool))
        shown[name] = ReconstructedObject(
            name, np.asarray(mesh.vertices), np.asarray(mesh.faces), *arrays, np.eye(4), float(mesh.volume)
        )
    write_reconstruction(paths.reconstruction_folder(CAPTURE), shown, {}, {}, {})
    prepared = Path("data/prepare")
    prepared.rename("away")
    try:
        assert sample.main(["--source", "reconstructed", "--object", "cube"]) == 0, capsys.readouterr()
        first = paths.sampled_file("reconstructed", "cube").read_bytes()
        assert sample.main(["--source", "reconstructed", "--object", "cube"]) == 0
    finally:
        Path("away").rename(prepared)
    assert paths.sampled_file("reconstructed", "cube").read_bytes() == first
    rows = read_flat(paths.sampled_file("reconstructed", "cube"), PAIR_GRASPS, "")
    assert (rows["rejected_by"] == "").sum() == 3 and set(rows["object1"]) == {"can"}
    assert set(json.loads(paths.sample_quality_file("reconstructed").read_text())["cube"]) == {"can"}
    assert sample.main(["--source", "reconstructed", "--object", "can"]) == 2
    assert "there is no object 'can' under `reconstructed`" in capsys.readouterr().err


def test_own_files_give_ranked_grasps_in_the_frames_of_the_files(model, tmp_path):
    mesh = trimesh.creation.box((0.05, 0.05, 0.05))
    mesh.apply_translation([1, 2, 3])
    mesh.export(tmp_path / "box.stl")
    cloud = trimesh.sample.sample_surface(trimesh.creation.cylinder(0.03, 0.1), 300, seed=0)[0]
    np.save(tmp_path / "can.npy", cloud)
    files = ["--object0", str(tmp_path / "box.stl"), "--object1", str(tmp_path / "can.npy")]
    assert propose.main([*files, "-n", "2", "--output", str(tmp_path / "out")]) == 0
    rows = read_table(tmp_path / "out/grasps.parquet", MERGED, "")
    assert len(rows) == 2
    assert [row["method"] for row in json.loads((tmp_path / "out/grasps.json").read_text())] == ["model"] * 2
    # The box lies far from its file's origin, the hand near the box.
    assert np.linalg.norm(rows["positions_hand_object"][0][0]) > 3
    page = (tmp_path / "out/grasps.html").read_text()
    assert "grasp 2" in page and 'src="http' not in page


def test_bad_input_is_one_sentence(model, tmp_path, capsys):
    assert sample.main([*LEARNED, "--object", "teapot"]) == 2
    assert "styles.pinch does not list 'teapot'" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        sample.main(["--object", "cube"])
    assert "--source" in capsys.readouterr().err
    assert propose.main(["--object0", "none.stl", "--object1", "none.stl"]) == 2
    error = capsys.readouterr().err
    assert "none.stl is missing" in error and len(error.strip().splitlines()) == 1
    with pytest.raises(SystemExit):
        propose.main(["--object0", "none.stl"])
    with pytest.raises(SystemExit):
        propose.main(["--object0", "none.stl", "--object1", "none.stl", "-n", "0"])
    assert "--object0" in capsys.readouterr().err


def test_without_a_model_the_stage_that_makes_it_is_named(model, capsys):
    model.rename(model.with_name("away"))
    try:
        assert sample.main([*LEARNED, "--object", "cube"]) == 2
        assert "run `dvc repro train`" in capsys.readouterr().err
    finally:
        model.with_name("away").rename(model)
