"""What a change makes DVC and the stages compute: real DVC, real stages at scale tiny."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import trimesh

from tests.pipeline.conftest import Repro, WorkingCopy
from tests.pipeline.declared import IN_GIT, declared_stages

UP_TO_DATE = "Data and pipelines are up to date."


def changed(workspace: WorkingCopy, dotted: str, value) -> None:
    """Set one parameter of the workspace."""
    content = workspace.parameters()
    section = content
    *parents, last = dotted.split(".")
    for parent in parents:
        section = section[parent]
    assert section.get(last) != value
    section[last] = value
    workspace.write_parameters(content)


def edited(file: Path, old: str, new: str) -> None:
    """Replace text that occurs in a file."""
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


# --- the finished run itself


def test_every_stage_ran_and_left_what_it_declares(finished):
    for stage in declared_stages(finished.root):
        for output in stage.outputs:
            assert (finished / output).exists(), output
    assert UP_TO_DATE in finished.dvc("status")


def test_a_run_changes_only_records_in_git(finished):
    listed = finished.git("show", "--name-only", "--format=", "HEAD").split()
    assert set(listed) <= {*IN_GIT, "params.yaml"}
    assert finished.git("status", "--porcelain") == ""


def test_nothing_half_written_is_left(finished):
    assert [path for folder in ("data", "reports") for path in (finished / folder).rglob("*.tmp")] == []


def test_the_page_needs_no_network(finished):
    text = (finished / "reports/index.html").read_text()
    assert re.findall(r"""(?:src|href)=["']?(?:https?:)?//[^"'> ]+\.(?:js|css|png|jpg|woff2?)\b""", text) == []


def test_headline_figures_are_in_the_summary(finished):
    summary = json.loads((finished / "reports/summary.json").read_text())
    assert summary["scale"] == "tiny"
    assert {
        "merge.grasps",
        "merge.min_per_pair",
        "validate.survival_rate_mean",
        "evaluate.synthesized.trials",
        "evaluate.synthesized.success_rate_mean",
        "evaluate.synthesized.success_rate_min_pair",
        "evaluate.synthesized.success_rate_mean_10cm",
        "evaluate.synthesized.planning_failure_rate",
        "evaluate.learned.success_rate_mean",
        "train.validation_loss",
        "train.penetration_mm_median",
        "train.contact_distance_mm_median",
        "validate.pinch.cube.optimised",
        "validate.pinch.cube.validated",
        "validate.pinch.cube.survival_rate",
        "reconstruct.tiny.registered_ratio",
        "reconstruct.tiny.reprojection_px",
        "reconstruct.tiny.alignment_mm",
        "reconstruct.tiny.chamfer_mm_max",
        "evaluate.conditions.distribution.sapien.synthesized.success_rate_mean",
    } <= set(summary)
    # Twelve small photos do, at half the resolution of the demo (tests/reconstruct/test_whole.py has others).
    assert summary["reconstruct.tiny.registered_ratio"] == 1 and summary["reconstruct.tiny.chamfer_mm_max"] < 1.5
    assert list(summary) == sorted(summary)
    assert finished.recorded_runs() >= 2  # a parent run and its stages


def test_the_example_of_the_data_card_runs(finished):
    card = (finished / "reports/dataset.md").read_text()
    (example,) = re.findall(r"```python\n(.*?)```", card, flags=re.DOTALL)
    done = finished.command(sys.executable, "-c", example)
    assert done.returncode == 0, done.stderr
    accepted = json.loads((finished / "reports/summary.json").read_text())["merge.grasps"]
    assert f"{accepted} two-object grasps of 1 pairs" in card
    assert re.search(rf"^cube +{accepted}$", done.stdout, re.MULTILINE), done.stdout


# --- changes


def test_no_change_runs_nothing_and_words_run_only_the_look_at_the_code(workspace):
    runs, before = workspace.recorded_runs(), workspace.fingerprints()
    result = workspace.repro()
    assert result.ran == result.restored == [] and UP_TO_DATE in result.output
    for source in (workspace / "pipeline").glob("*/*.py"):
        text = source.read_text()
        assert text.startswith('"""')
        source.write_text(text.replace('"""', '"""Other words: ', 1) + "\n# a comment\n")
    changed(workspace, "compute.workers", 2)  # no parameter of any stage
    assert workspace.repro().ran == ["code"]
    assert workspace.fingerprints() == before
    assert workspace.recorded_runs() == runs


@pytest.mark.slow
def test_a_function_runs_its_own_stages_and_those_that_read_other_rows(workspace):
    tables = workspace.fingerprints("data/synthesize", "data/merge")
    edited(workspace / "pipeline/validate/table.py", "ValidationReason.NOT_TESTED.value", '"left"')
    result = workspace.repro("evaluate@synthesized")
    # Candidates that were not tested have another word, and no pair has other grasps for that.
    assert result.ran == ["code", "validate@pinch", "validate@side", "merge"]
    assert result.computed == {"validate@pinch": (1, 1), "validate@side": (1, 1), "merge": (1, 1)}
    assert workspace.fingerprints("data/synthesize", "data/merge") == tables


@pytest.mark.slow
def test_a_pinch_parameter_runs_no_side_stage_and_the_way_back_none(workspace):
    before = workspace.fingerprints()
    original = (workspace / "params.yaml").read_text()
    changed(workspace, "synthesize.pinch.chains", 16)
    assert workspace.repro("merge").ran == ["code", "synthesize@pinch", "validate@pinch", "merge"]
    (workspace / "params.yaml").write_text(original)
    result = workspace.repro("merge")
    assert result.ran == ["code"]  # DVC keeps no runs of a stage with a file that only git keeps
    assert result.restored == ["synthesize@pinch", "validate@pinch", "merge"]
    assert workspace.fingerprints() == before


@pytest.mark.slow
def test_a_condition_runs_its_own_trials_and_is_recorded_once(workspace):
    runs, before = workspace.recorded_runs(), workspace.fingerprints()
    original = (workspace / "params.yaml").read_text()
    changed(workspace, "conditions.settings.slippery", {"friction": 0.5})
    result = workspace.repro()
    assert result.ran == ["code", "evaluate-conditions", "report", "track"]
    assert result.computed == {"evaluate-conditions": (1, 2)}
    found = workspace.fingerprints("data")
    assert {path for path in found if found[path] != before.get(path)} == {
        "data/evaluate/conditions/synthesized-slippery-sapien.parquet",
        "data/items/evaluate-conditions.json",
    }
    after = workspace.recorded_runs()
    assert after > runs
    (workspace / "params.yaml").write_text(original)
    assert workspace.repro().computed == {}
    assert workspace.fingerprints() == before
    assert workspace.recorded_runs() == after


@pytest.mark.slow
def test_an_object_of_one_s_own_comes_changes_and_goes(workspace):
    """Only its own items are computed, and none when it goes, whatever DVC remembers of earlier runs."""
    before = workspace.fingerprints("data")
    original = (workspace / "params.yaml").read_text()
    content = workspace.parameters()
    trimesh.creation.box((40, 45, 42)).export(workspace / "data/raw/small_box.stl")
    content["meshes"]["small_box"] = {"file": "data/raw/small_box.stl", "unit": "mm"}
    content["styles"]["pinch"].append("small_box")
    workspace.write_parameters(content)
    targets = ("evaluate@synthesized", "reconstruct")
    for_other_style = {"synthesize@side": (0, 1), "validate@side": (0, 1)}
    pinched = {"prepare": (1, 3), "synthesize@pinch": (1, 2), "validate@pinch": (1, 2), "merge": (1, 2)}
    photos = {"capture": (0, 1), "reconstruct": (0, 1)}
    result = workspace.repro(*targets)
    assert result.computed == {**for_other_style, **pinched, **photos, "evaluate@synthesized": (1, 2)}
    content["meshes"]["small_box"]["density"] = 700.0
    workspace.write_parameters(content)
    assert workspace.repro("merge").computed == {**for_other_style, **pinched}
    (workspace / "params.yaml").write_text(original)
    shutil.rmtree(workspace / ".dvc/cache/runs")
    result = workspace.repro(*targets)
    # The file of the mesh is still there, and photos are as they were: nothing to reconstruct.
    assert set(result.computed) == {*for_other_style, *pinched, "capture", "evaluate@synthesized"}
    assert {computed for computed, _ in result.computed.values()} == {0}
    assert workspace.fingerprints("data") == before
    assert UP_TO_DATE in workspace.dvc("status")


@pytest.mark.slow
def test_an_experiment_in_a_folder_of_its_own_takes_the_items_of_the_workspace(workspace):
    changed(workspace, "evaluate.trials", 2)
    workspace.repro("evaluate@synthesized")
    before = workspace.fingerprints()
    composed = ("--set-param", "scale=tiny", "--set-param", "evaluate.trials=3")
    printed = workspace.dvc("exp", "run", "--temp", *composed, "evaluate@synthesized")
    result = Repro(0, printed)
    assert result.ran == ["code", "evaluate@synthesized"]
    assert result.computed == {"evaluate@synthesized": (1, 3)}
    assert workspace.fingerprints() == before


def test_grasps_of_one_object_are_taken_from_another_folder(finished, tmp_path):
    table = "data/validate/pinch/cube.parquet"
    got = WorkingCopy(tmp_path)
    got.dvc("get", str(finished.root), table)
    assert (got / "cube.parquet").read_bytes() == (finished / table).read_bytes()


# --- things that go wrong


@pytest.mark.slow
def test_a_killed_stage_goes_on_at_the_trial_it_was_at_and_ends_with_the_same_bytes(workspace, tmp_path):
    changed(workspace, "evaluate.trials", 4)
    with (tmp_path / "log").open("w") as output:
        process = subprocess.Popen(
            [sys.executable, "-m", "dvc", "repro", "evaluate@synthesized"],
            cwd=workspace.root,
            stdout=output,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            start_new_session=True,
        )
    done, deadline = workspace / "data/.unfinished/evaluate@synthesized", time.monotonic() + 600
    while process.poll() is None and time.monotonic() < deadline and not list(done.glob("*.pickle")):
        time.sleep(0.05)
    assert process.poll() is None, (tmp_path / "log").read_text()
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert not (workspace / "data/evaluate/synthesized").exists()
    finished = len(list(done.glob("*.pickle")))
    assert finished in (1, 2)
    result = workspace.repro("evaluate@synthesized")
    # Which grasp the first trial tries depends on their number: it may be that of the first run.
    assert result.computed["evaluate@synthesized"] in [(3 - finished, 4), (4 - finished, 4)]
    assert f"{finished} finished by an interrupted run" in result.output
    resumed = workspace.fingerprints()
    result = workspace.repro("--force", "--single-item", "evaluate@synthesized", RECOMPUTE="1")
    assert result.computed == {"evaluate@synthesized": (4, 4)}
    assert workspace.fingerprints() == resumed


@pytest.mark.slow
def test_a_damaged_table_is_named_and_made_again_by_hand_or_by_dvc(finished, workspace):
    table, before = workspace / "data/validate/pinch/cube.parquet", finished.fingerprints()
    table.write_bytes(table.read_bytes()[:-100])
    done = workspace.command(sys.executable, "-m", "pipeline.merge", "--object", "cube")
    assert done.returncode == 2
    said = done.stderr.splitlines()[-1]  # after the progress bar
    assert "data/validate/pinch/cube.parquet" in said and "dvc repro validate@pinch" in said
    done = workspace.command(sys.executable, "-m", "pipeline.validate", "--style", "pinch", "--object", "cube")
    assert done.returncode == 0, done.stderr
    by_hand = workspace.fingerprints()
    assert before.keys() - by_hand.keys() == {"data/items/validate-pinch.json"}  # it tells of whole runs of the stage
    assert by_hand == {name: digest for name, digest in before.items() if name in by_hand}
    # One is missing, one belongs to nothing.
    table.rename(table.with_name("stranger.parquet"))
    assert workspace.repro().ran == []
    assert workspace.fingerprints() == before
