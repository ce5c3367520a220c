"""A published folder, by the readers of those who take it: pandas, mlcroissant, sha256sum, LeRobot."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import mlcroissant
import numpy as np
import pandas as pd
import pytest
import trimesh
import yaml

import seqgrasp
from pipeline.evaluate.rerun import TrialName
from pipeline.hand.model import load_hand
from pipeline.pictures.film import Film
from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.objects import write_prepared_object
from pipeline.records.recordings import About, Recording
from pipeline.share.episodes import Episode, write_episodes
from pipeline.share.publish import main
from tests.objects import prepared
from tests.share.made_up import PARAMETERS, PINCH, SIDE, write_tables

LEROBOT = ["uv", "run", "--no-project", "--quiet", "--python", "3.11", "--with", "lerobot==0.4.4", "python"]
HELD_OUT = {"pinch.cube": [0]}  # single grasps; each is in one merged grasp of a pair


def write_results(folder: Path, repository: Path) -> None:
    """Tables of made-up grasps, their objects, and a model of which only the description is read."""
    write_tables(folder, learned=False)
    content = yaml.safe_load((repository / "params.yaml").read_text()) | PARAMETERS
    (folder / "params.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    for name in (*PINCH, *SIDE):
        item = prepared(
            name, trimesh.creation.box([0.04] * 3), provenance={"source": "recipe box", "licence": "own work, MIT"}
        )
        write_prepared_object(folder / paths.prepared_folder(name), item)
    model = folder / paths.MODEL_FOLDER
    model.mkdir(parents=True)
    (model / "model.json").write_text(json.dumps({"held_out": HELD_OUT, "pairs": [["cube", "can"]]}))
    for name in ("model.safetensors", "history.csv"):
        (model / name).write_text("as it is")


@pytest.fixture
def published(empty_folder, repository) -> Path:
    write_results(empty_folder, repository)
    assert main(["dataset", "--trials", "0"]) == 0
    return empty_folder / "dataset"


def test_splits_are_by_what_the_model_has_seen(published):
    ours = seqgrasp.load_grasps()
    train, test = (
        pd.read_parquet(published / f"data/synthesized/{name}-00000-of-00001.parquet") for name in ("train", "test")
    )
    assert len(train) + len(test) == len(ours)
    unseen = ours[(ours["object0"] == "cube") & (ours["grasp0_id"] == 0)]
    assert 0 < len(test) == len(unseen) and set(test["merged_id"]) == set(unseen["merged_id"])


def test_load_grasps_reads_the_folder(published):
    ours, theirs = seqgrasp.load_grasps(), seqgrasp.load_grasps(published)
    key = ["object0", "object1", "merged_id"]
    ours, theirs = (table.sort_values(key).reset_index(drop=True) for table in (ours, theirs))
    assert list(theirs.columns) == list(ours.columns)
    np.testing.assert_array_equal(np.stack(theirs["q"]), np.stack(ours["q"]))
    assert set(seqgrasp.load_grasps(published, first="plum")["object0"]) == {"plum"}
    with pytest.raises(UserError, match="has no learned grasps"):
        seqgrasp.load_grasps(published, source="learned")
    with pytest.raises(UserError, match="has no first 'pear'"):
        seqgrasp.load_grasps(published, first="pear")


def test_croissant_is_valid_and_loads_every_split(published):
    dataset = mlcroissant.Dataset(jsonld=published / "croissant.json")
    assert not dataset.metadata.ctx.issues.errors and not dataset.metadata.ctx.issues.warnings
    assert str(dataset.metadata.ctx.conforms_to.value).endswith("1.1")
    for split in ("train", "test"):
        table = pd.read_parquet(published / f"data/synthesized/{split}-00000-of-00001.parquet")
        records = list(dataset.records(f"synthesized_{split}"))
        assert len(records) == len(table)
        for record, q in zip(records, table["q"], strict=True):
            np.testing.assert_array_equal(np.asarray(record[f"synthesized_{split}/q"], float), q)


def test_the_header_tells_what_is_there(published):
    text = (published / "README.md").read_text()
    header = yaml.safe_load(text.split("---\n")[1])
    assert header["license"] == "mit" and header["size_categories"] == ["n<1K"]
    for config, info in zip(header["configs"], header["dataset_info"], strict=True):
        for file, split in zip(config["data_files"], info["splits"], strict=True):
            table = pd.read_parquet(published / file["path"])
            assert (file["split"], len(table)) == (split["name"], split["num_examples"])
            assert [feature["name"] for feature in info["features"]] == list(table.columns)
            assert (published / file["path"]).stat().st_size == split["num_bytes"]
    card = (published / "model/README.md").read_text()
    assert yaml.safe_load(card.split("---\n")[1])["license"] == "mit" and "cube then can" in card


def test_checksums_are_those_of_sha256sum(published):
    check = ["sha256sum", "--check", "--strict", "--quiet", "SHA256SUMS"]
    assert subprocess.run(check, cwd=published).returncode == 0
    listed = {line.split("  ")[1] for line in (published / "SHA256SUMS").read_text().splitlines()}
    there = {str(path.relative_to(published)) for path in published.rglob("*") if path.is_file()}
    assert listed == there - {"SHA256SUMS"}
    (published / "objects/cube.ply").write_bytes(b"another")
    assert subprocess.run(check, cwd=published, capture_output=True).returncode != 0


def test_what_cannot_be_published_is_told_and_leaves_nothing(empty_folder, repository, capsys):
    write_results(empty_folder, repository)
    shutil.rmtree(empty_folder / "data/merge")
    assert main(["dataset", "--trials", "0"]) == 2
    assert "run `dvc repro merge`" in capsys.readouterr().err
    assert not (empty_folder / "dataset").exists() and not list(empty_folder.glob("*.tmp"))
    (empty_folder / "there").mkdir()
    assert main(["there"]) == 2 and "is there already" in capsys.readouterr().err


# --- trials


def episode(number: int, moments: int) -> Episode:
    """The arm turns and an object rises, 50 moments per second."""
    time = (np.arange(moments) + 1) / 50
    q = np.zeros((moments, 23))
    q[:, 3], q[:, 5], q[:, 0] = -2.0, 2.0, np.linspace(0, 0.5 + number, moments)
    poses = np.tile([0.5, 0.0, 0.12, 1.0, 0.0, 0.0, 0.0], (2, moments, 1))
    poses[1, :, 2] += np.linspace(0, 0.2, moments)
    half = moments // 2
    recording = Recording(
        About(f"synthesized/cube/can/{number}", ("cube", "can"), "success", 0.1),
        time,
        ["settle"] * half + ["hold"] * (moments - half),
        q,
        poses,
    )
    row = {"merged_id": 7, "success": True, "reason": ""}
    return Episode(TrialName("synthesized", ("cube", "can"), number), row, recording, q + 0.01)


READ = """
import json, sys
import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset
data = LeRobotDataset("local/trials", root=sys.argv[1], video_backend="pyav")
items = [data[index] for index in (0, 9, 10, len(data) - 1)]
print(json.dumps({
    "episodes": data.num_episodes, "frames": data.num_frames, "fps": data.fps,
    "state": np.stack([item["observation.state"].numpy() for item in items]).tolist(),
    "action": np.stack([item["action"].numpy() for item in items]).tolist(),
    "task": items[0]["task"], "subtask": [item.get("subtask") for item in items],
    "picture": list(items[0]["observation.images.scene"].shape),
    "brightness": [float(item["observation.images.scene"].mean()) for item in items],
}))
"""


@pytest.mark.slow
def test_lerobot_opens_the_trials(empty_folder):
    for name in ("cube", "can"):
        write_prepared_object(paths.prepared_folder(name), prepared(name, trimesh.creation.box([0.04] * 3)))
    episodes = [episode(0, 50), episode(1, 60)]
    target = empty_folder / "trials"
    target.mkdir()
    write_episodes(target, episodes, load_hand("allegro"), Film(64, 48, 10), True)
    environment = subprocess.run([*LEROBOT, "-c", "import lerobot"], capture_output=True, text=True)
    if environment.returncode:
        pytest.skip(f"lerobot cannot be installed beside: {environment.stderr.strip()[-200:]}")
    done = subprocess.run([*LEROBOT, "-c", READ, str(target)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    assert (found["episodes"], found["frames"], found["fps"]) == (2, 22, 10)
    shown = np.concatenate([own.recording.robot_q[::5] for own in episodes])[[0, 9, 10, 21]]
    np.testing.assert_allclose(found["state"], shown, atol=0.03)
    np.testing.assert_allclose(np.array(found["action"]) - found["state"], 0.01, atol=1e-6)
    assert found["task"] == "Pick up the cube and keep it in the hand, then pick up the can."
    assert found["subtask"] == ["settle", "hold", "settle", "hold"] and found["picture"] == [3, 48, 64]
    assert min(found["brightness"]) > 0.2
