"""docs/adding-an-object.md, as a reader follows it."""

import pytest
import trimesh

from tests.pipeline.conftest import WorkingCopy


@pytest.mark.slow
def test_the_page_s_commands_add_an_object_and_touch_no_other(workspace: WorkingCopy, tmp_path):
    """docs/adding-an-object.md, command by command, in a finished pipeline of scale tiny."""
    page = (workspace / "docs/adding-an-object.md").read_text()
    for line in ("./dev add-object ~/Downloads/mug.stl --style pinch", "dvc repro validate-pinch@mug"):
        assert f"\n{line}\n" in page
    before = workspace.fingerprints()
    mug = tmp_path / "mug.stl"
    trimesh.creation.cylinder(radius=21, height=45).export(mug)
    done = workspace.command("python", "-m", "pipeline.workspace.add_object", str(mug), "--style", "pinch")
    assert done.returncode == 0, done.stderr
    assert "taken as mm" in done.stderr and "DVC could not" not in done.stderr
    assert workspace.repro("validate-pinch@mug").ran == ["synthesize-pinch@mug", "validate-pinch@mug"]
    assert {name: value for name, value in workspace.fingerprints().items() if name in before} == before
    # Shared through DVC's storage, in a clone that computes nothing of the object again.
    for command in (["add", "data/raw/mug.stl"], ["remote", "add", "--default", "lab", str(tmp_path / "remote")]):
        workspace.dvc(*command)
    workspace.dvc("push")
    workspace.commit("Add a mug")
    clone = WorkingCopy(tmp_path / "clone")
    workspace.git("clone", "--quiet", str(workspace.root), str(clone.root))
    assert not (clone / "data/raw/mug.stl").exists()
    assert clone.repro("--pull", "validate-pinch@mug").ran == []
    table = "data/validate/pinch/mug.parquet"
    assert clone.fingerprints("data/validate")[table] == workspace.fingerprints("data/validate")[table]
