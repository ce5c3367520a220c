"""What a change makes DVC run: real DVC, real stages at scale tiny, one change per test."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time

import pyarrow.parquet as pq
import pytest
import trimesh

from tests.pipeline.conftest import WorkingCopy
from tests.pipeline.declared import declared_stages

pytestmark = pytest.mark.slow

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


def objects_in_tables(workspace: WorkingCopy) -> dict[str, set[str]]:
    """Return, for every table of a gathering stage, the objects in its rows and in its name."""
    found = {}
    for folder in ("data/validate", "data/merge", "data/train", "data/evaluate"):
        for path in sorted((workspace / folder).rglob("*.parquet")):
            table = pq.read_table(path)
            names = {
                name
                for column in table.column_names
                if column.startswith("object")
                for name in table[column].to_pylist()
            }
            found[str(path.relative_to(workspace.root))] = names | {path.stem, path.parent.name} - {
                "pinch",
                "side",
                "synthesized",
                "learned",
                "reconstructed",
            }
    return found


# --- the finished run itself


def test_every_stage_ran_and_left_what_it_declares(finished):
    for stage in declared_stages(finished.root):
        for output in stage.outputs:
            assert (finished / output).exists(), output
    assert UP_TO_DATE in finished.dvc("status")


def test_a_run_changes_only_records_in_git(finished):
    listed = finished.git("show", "--name-only", "--format=", "HEAD").split()
    assert set(listed) <= {
        "dvc.lock",
        "params.yaml",
        "reports/dataset.md",
        "reports/summary.json",
        "reports/tracking.json",
        "reports/durations.json",
        "reports/survival.csv",
        "reports/success.csv",
    }
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
        "evaluate.harder.placement.success_rate_mean",
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


def test_no_change_runs_nothing_and_records_nothing(workspace):
    runs, before = workspace.recorded_runs(), workspace.fingerprints()
    result = workspace.repro()
    assert result.ran == [] and result.restored == []
    assert UP_TO_DATE in result.output
    assert workspace.recorded_runs() == runs
    assert workspace.fingerprints() == before


def test_a_pinch_parameter_runs_no_side_stage(workspace):
    before = workspace.fingerprints()
    original = (workspace / "params.yaml").read_text()
    changed(workspace, "synthesize.pinch.chains", 65)
    # Merging comes after all stages of the other style and all preparation; what follows it is none of them.
    assert workspace.repro("merge@cube").ran == ["synthesize-pinch@cube", "validate-pinch@cube", "merge@cube"]
    # Back to the first value: data are restored.
    (workspace / "params.yaml").write_text(original)
    assert workspace.repro("merge@cube").ran == []
    assert workspace.fingerprints() == before


def test_a_harder_setting_runs_its_own_trials_and_no_others(workspace):
    runs, before, data = workspace.recorded_runs(), workspace.fingerprints(), workspace.fingerprints("data")
    original = (workspace / "params.yaml").read_text()
    changed(workspace, "harder.settings.placement.evaluate.perturbation", 0.02)
    assert workspace.repro().ran == ["evaluate-harder@placement", "report", "track"]
    found = workspace.fingerprints("data")
    assert {path for path in found if found[path] != data.get(path)} == {"data/evaluate/harder/placement.parquet"}
    after = workspace.recorded_runs()
    assert after > runs
    # Back to the first value: data are restored, no run is added.
    (workspace / "params.yaml").write_text(original)
    # The report draws again, as DVC keeps no runs of a stage with a file that only git keeps (reports/dataset.md); the
    # record is looked for, and found.
    assert set(workspace.repro().ran) <= {"report", "track"}
    assert workspace.fingerprints() == before
    assert workspace.recorded_runs() == after


def test_workers_are_no_parameter_of_any_stage(workspace):
    changed(workspace, "compute.workers", 2)
    assert workspace.repro().ran == []


@pytest.mark.parametrize(
    ("room", "stages"),
    [
        ("prepare", ["prepare@cube", "prepare@slender_cylinder"]),
        ("merge", ["merge@cube"]),
        ("train", ["train"]),
        ("evaluate", ["evaluate-synthesized@cube", "evaluate-learned@cube", "evaluate-reconstructed@cube"]),
        ("report", ["report"]),
    ],
)
def test_a_comment_runs_its_stage_and_nothing_after_it(workspace, room, stages):
    before, runs = workspace.fingerprints(), workspace.recorded_runs()
    with (workspace / f"pipeline/{room}/__main__.py").open("a") as source:
        source.write("# a comment\n")
    assert sorted(workspace.repro().ran) == sorted(stages)
    assert workspace.fingerprints() == before
    assert workspace.recorded_runs() == runs


def test_an_object_of_one_s_own_comes_and_goes(workspace):
    before, tables = workspace.fingerprints(), objects_in_tables(workspace)
    original = (workspace / "params.yaml").read_text()
    content = workspace.parameters()
    trimesh.creation.box((40, 45, 42)).export(workspace / "data/raw/small_box.stl")
    content["meshes"]["small_box"] = {"file": "data/raw/small_box.stl", "unit": "mm"}
    content["styles"]["pinch"].append("small_box")
    workspace.write_parameters(content)
    # Photos are rendered again, as the folder of prepared objects is another; they are the same, and no more follows.
    ran = [name for name in workspace.repro().ran if name != "capture@tiny"]
    own = ["prepare-mesh@small_box", "synthesize-pinch@small_box", "validate-pinch@small_box"]
    assert ran[:3] == own and "merge@small_box" in ran
    later = ("merge@", "train", "sample", "evaluate-", "report", "track")
    assert [name for name in ran[3:] if not name.startswith(later)] == []
    assert "evaluate-synthesized@small_box" in ran
    runs, with_box = workspace.recorded_runs(), objects_in_tables(workspace)
    assert {path for path, names in with_box.items() if "small_box" in names} == {
        "data/validate/pinch/small_box.parquet",
        "data/merge/small_box/slender_cylinder.parquet",
        "data/train/small_box/slender_cylinder.parquet",
        "data/evaluate/synthesized/small_box.parquet",
        "data/evaluate/learned/small_box.parquet",
    }
    assert with_box["data/validate/pinch/cube.parquet"] == tables["data/validate/pinch/cube.parquet"]
    # Gone again: gathered anew without it, and nothing of it is left where others gather.
    (workspace / "params.yaml").write_text(original)
    gone = workspace.repro()
    cube = {"merge@cube", "train", "sample@cube", "evaluate-synthesized@cube", "evaluate-learned@cube"}
    shown = {"capture@tiny", "sample-reconstructed@cube", "evaluate-reconstructed@cube"}
    assert set(gone.ran) <= {*shown, *cube, "evaluate-harder@placement", "report", "track"}, gone.output
    assert workspace.recorded_runs() == runs
    assert objects_in_tables(workspace) == tables
    assert "small_box" not in (workspace / "reports/summary.json").read_text()
    assert "small_box" not in (workspace / "reports/index.html").read_text()
    left = {name: value for name, value in workspace.fingerprints().items() if not name.startswith("data/synthesize")}
    assert left == {name: value for name, value in before.items() if not name.startswith("data/synthesize")}
    assert workspace.repro().ran == []
    assert UP_TO_DATE in workspace.dvc("status")


def test_a_stray_table_reaches_no_result(workspace):
    before = workspace.fingerprints()
    shutil.copy(workspace / "data/validate/pinch/cube.parquet", workspace / "data/validate/pinch/stranger.parquet")
    assert set(workspace.repro().ran) <= {"merge@cube", "report"}
    assert workspace.fingerprints() == before


def test_a_colleague_s_clone_computes_nothing(finished, workspace, tmp_path):
    remote = tmp_path / "remote"
    workspace.dvc("remote", "add", "--default", "shared", str(remote))
    workspace.dvc("push")
    workspace.commit("Name the remote")
    clone = WorkingCopy(tmp_path / "clone")
    subprocess.run(["git", "clone", "--quiet", str(workspace.root), str(clone.root)], check=True)
    result = clone.repro("--pull")
    assert result.ran == []
    assert clone.fingerprints() == finished.fingerprints()
    assert UP_TO_DATE in clone.dvc("status")


# --- things that go wrong


def test_a_killed_stage_leaves_nothing_and_ends_with_the_same_bytes(finished, workspace, tmp_path):
    target = workspace / "data/validate/side/slender_cylinder.parquet"
    target.unlink()
    workspace.forget("validate-side@slender_cylinder")  # so that it is computed, not restored
    changed(workspace, "compute.workers", 2)  # that are killed too
    log = tmp_path / "log"
    with log.open("w") as output:
        process = subprocess.Popen(
            [sys.executable, "-m", "dvc", "repro", "validate-side@slender_cylinder"],
            cwd=workspace.root,
            stdout=output,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            start_new_session=True,
        )
    deadline = time.monotonic() + 120
    while process.poll() is None and time.monotonic() < deadline and not re.search(r"\| [1-9]\d*/", log.read_text()):
        time.sleep(0.05)
    assert process.poll() is None, log.read_text()
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert not target.exists()
    result = workspace.repro()
    assert result.ran == ["validate-side@slender_cylinder"]
    assert workspace.fingerprints() == finished.fingerprints()


def test_a_truncated_table_is_named_by_the_stage_and_mended_by_dvc(finished, workspace):
    table = workspace / "data/validate/pinch/cube.parquet"
    table.write_bytes(table.read_bytes()[:-100])
    before = workspace.fingerprints("data/merge")
    done = workspace.command(sys.executable, "-m", "pipeline.merge", "--object", "cube")
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        "merge@cube: data/validate/pinch/cube.parquet is damaged or not a parquet file; "
        "delete it and run `dvc repro validate-pinch@cube` to make it again."
    ]
    assert workspace.fingerprints("data/merge") == before
    assert workspace.repro().ran == []
    assert workspace.fingerprints() == finished.fingerprints()


def test_a_missing_mesh_stops_the_pipeline_and_names_the_file(workspace):
    content = workspace.parameters()
    content["meshes"]["mug"] = {"file": "data/raw/mug.stl"}
    content["styles"]["pinch"].append("mug")
    workspace.write_parameters(content)
    result = workspace.repro(succeed=False)
    assert result.ran == []
    assert "data/raw/mug.stl" in result.output
    assert "Traceback" not in result.output
    assert not (workspace / "data/prepare/mug").exists()


def test_a_stage_that_refuses_stops_the_pipeline_with_its_sentence(workspace):
    content = workspace.parameters()
    content["meshes"]["mug"] = {"file": "data/raw/mug.stl"}
    content["styles"]["pinch"].append("mug")
    workspace.write_parameters(content)
    (workspace / "data/raw/mug.stl").write_text("this is no mesh")
    result = workspace.repro(succeed=False)
    assert result.ran == ["prepare-mesh@mug"]
    assert "prepare-mesh@mug: " in result.output and "data/raw/mug.stl" in result.output
    assert "Traceback" not in result.output
    assert not (workspace / "data/prepare/mug").exists()
