"""Every example runs as its first lines say, and prints what it found."""

import os
import subprocess
from pathlib import Path

import pytest
import trimesh
import yaml

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.usefixtures("warm")
EXAMPLES = sorted(path.name for path in (ROOT / "examples").glob("*.py"))


def printed(name: str, *arguments: str, folder: Path = ROOT) -> list[str]:
    """Run an example as a user would and return the lines that it prints."""
    done = subprocess.run(
        ["python", f"examples/{name}", *arguments],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_examples_are_short():
    assert len(EXAMPLES) == 8
    assert max(len((ROOT / "examples" / name).read_text().splitlines()) for name in EXAMPLES) <= 50


@pytest.mark.slow
def test_own_grasps_are_scored():
    found, *spoilt = printed("02_score_own_grasps.py")[1:]
    assert found.endswith("holds") and len(spoilt) == 2


@pytest.mark.slow
def test_one_mesh_is_synthesized_for(tmp_path):
    trimesh.creation.cylinder(20, 50).export(tmp_path / "tin.stl")
    first, _, *rows = printed("03_synthesize_for_one_mesh.py", str(tmp_path / "tin.stl"))
    assert first.startswith("tin: ") and len(rows) == 12 and any(row.endswith("valid") for row in rows)


@pytest.mark.slow
def test_a_check_of_ones_own_rejects_what_it_should():
    lines = printed("06_add_validation_check.py")
    rows = [line.split() for line in lines[lines.index(next(line for line in lines if "grasp_id" in line)) + 1 :]]
    assert rows and all((float(row[2]) < 0.02) == (row[3:] == ["joint_margin"]) for row in rows)


@pytest.mark.slow
def test_another_source_of_objects_is_grasped():
    lines = printed("07_another_source_of_objects.py")
    assert [line.split(":")[0] for line in lines] == [f"prism_{corners}" for corners in range(3, 7)]


def test_the_data_set_is_loaded(finished):
    lines = printed("01_load_dataset.py", folder=finished.root)
    assert lines[0].split()[0] == str(finished.parameters()["merge"]["grasps_per_pair"])


@pytest.mark.slow
def test_the_model_is_sampled(workspace):
    """The model of scale tiny is no good, so its samples are taken unchecked."""
    content = workspace.parameters()
    content["train"]["sampling"]["check"] = False
    workspace.write_parameters(content)
    lines = printed("04_sample_from_model.py", folder=workspace.root)
    assert any(line.split()[:1] == ["0"] for line in lines)
    assert (workspace / "grasps/grasps.html").is_file()


def test_a_trial_is_replayed(finished):
    lines = printed("05_replay_trial.py", "synthesized/cube/slender_cylinder/0", folder=finished.root)
    assert lines[-1] == "the same as recorded, to the last bit"


@pytest.mark.slow
def test_two_results_are_compared(workspace):
    content = workspace.parameters()
    content["physics"]["object_friction"] = 0.6
    workspace.write_parameters(content)
    lines = printed("08_compare_experiments.py", folder=workspace.root)
    changed = [line for line in lines if "physics.object_friction" in line]
    before = yaml.safe_load(workspace.git("show", "HEAD:params.yaml"))["physics"]["object_friction"]
    assert len(changed) == 1 and changed[0].split()[-2:] == [str(before), "0.6"]
