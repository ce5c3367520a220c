"""docs/adding-an-object.md, as a colleague follows it who has the results from a remote."""

import re

import pytest
import trimesh

from tests.pipeline.conftest import WorkingCopy


@pytest.mark.slow
def test_a_colleague_adds_an_object_and_computes_nothing_else(finished, workspace: WorkingCopy, tmp_path):
    workspace.dvc("remote", "add", "--default", "lab", str(tmp_path / "remote"))
    workspace.dvc("push")
    workspace.commit("Name the remote")
    clone = WorkingCopy(tmp_path / "clone")
    workspace.git("clone", "--quiet", str(workspace.root), str(clone.root))
    assert clone.repro("--pull").ran == []
    before = finished.fingerprints()
    assert clone.fingerprints() == before

    page = (workspace / "docs/adding-an-object.md").read_text()
    assert "\n./dev add-object ~/Downloads/mug.stl --style pinch\n" in page
    assert re.search(r"^(\./dev|dvc) repro validate@pinch$", page, re.MULTILINE)
    mug = tmp_path / "mug.stl"
    trimesh.creation.cylinder(radius=21, height=45).export(mug)
    done = clone.command("python", "-m", "tools.add_object", str(mug), "--style", "pinch")
    assert done.returncode == 0, done.stderr
    assert "taken as mm" in done.stderr
    clone.dvc("add", "data/raw/mug.stl")
    result = clone.repro("validate@pinch")
    assert result.ran == ["code", "prepare", "synthesize@pinch", "validate@pinch"]
    assert result.computed == {"prepare": (1, 3), "synthesize@pinch": (1, 2), "validate@pinch": (1, 2)}
    after = clone.fingerprints()
    assert {name for name in before if after[name] != before[name]} == {
        f"data/items/{stage}.json" for stage in ("prepare", "synthesize-pinch", "validate-pinch")
    }

    # Shared through DVC's storage, with those who compute nothing of the object again.
    clone.dvc("push")
    clone.commit("Add a mug")
    workspace.git("pull", "--quiet", str(clone.root))
    assert not (workspace / "data/raw/mug.stl").exists()
    workspace.dvc("pull")
    assert workspace.repro("--pull", "validate@pinch").ran == []
    assert workspace.fingerprints("data/validate") == clone.fingerprints("data/validate")
