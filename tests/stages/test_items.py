"""Only items that were not made before are computed, with real DVC; outputs have the bytes of a run from nothing."""

import json
import os
import random
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
STAGE = {
    "stages": {
        "squares": {
            "cmd": f"python {Path(__file__).with_name('toy_stage.py')}",
            "params": ["numbers", "code", "kind"],
            "outs": ["out", "data/items/squares.json"],
        }
    }
}


class Project:
    """A DVC project with one stage of items, in an existing folder."""

    def __init__(self, folder: Path, kind: str) -> None:
        self.folder, self.log = folder, folder.parent / f"{folder.name}.log"
        self.environment = os.environ | {"LOG": str(self.log), "PYTHONPATH": str(ROOT)}
        self.parameters = {"code": 1, "kind": kind, "numbers": {"a": {1: 1, 2: 2}, "b": {1: 3, 2: 4, 3: 5}}}

    def run(self, *command: str, **environment: str) -> subprocess.CompletedProcess[str]:
        command = ("python", "-m", *command) if command[0] == "dvc" else command
        return subprocess.run(
            command, cwd=self.folder, env=self.environment | environment, capture_output=True, text=True
        )

    def repro(self, *options: str, **environment: str) -> list[str]:
        """Bring the output up to date and return the keys of the items that were computed, sorted."""
        self.log.write_text("")
        (self.folder / "params.yaml").write_text(yaml.safe_dump(self.parameters))
        done = self.run("dvc", "repro", *options, **environment)
        assert (done.returncode == 0) != bool({"KILL", "FAIL", "REFUSE"} & environment.keys()), done.stderr
        self.said = done.stdout + done.stderr
        return sorted(self.log.read_text().split())

    def output(self) -> dict[str, bytes]:
        paths = [path for folder in ("out", "data/items") for path in (self.folder / folder).rglob("*")]
        return {
            str(path.relative_to(self.folder)): path.read_bytes()
            for path in paths
            if path.is_file() and path.name[0] != "."
        }

    def from_nothing(self) -> dict[str, bytes]:
        """Return the output of the same parameters where nothing was made before."""
        other = Project(self.folder.with_name(f"{self.folder.name}-nothing"), self.parameters["kind"])
        shutil.rmtree(other.folder, ignore_errors=True)
        other.folder.mkdir()
        shutil.copy(self.folder / "params.yaml", other.folder)
        done = other.run(*STAGE["stages"]["squares"]["cmd"].split())
        assert done.returncode == 0, done.stderr
        return other.output()


def run_once(folder: Path, kind: str) -> None:
    """Make a project whose stage has run."""
    folder.mkdir()
    (folder / "dvc.yaml").write_text(yaml.safe_dump(STAGE))
    (folder / ".dvcignore").write_text("/data/.unfinished\n*.tmp\n")
    made = Project(folder, kind)
    made.run("git", "init", "-q")
    made.run("dvc", "init", "-q")
    assert made.repro() == ["a/1", "a/2", "b/1", "b/2", "b/3"]
    assert made.output() == made.from_nothing()


@pytest.fixture
def project(tmp_path, made_once, request, warm) -> Project:
    """A project whose stage has run; it writes tables, or what a test asks for indirectly."""
    kind = getattr(request, "param", "tables")
    shutil.copytree(made_once(f"toy-{kind}", lambda folder: run_once(folder, kind)), tmp_path / "project")
    return Project(tmp_path / "project", kind)


@pytest.mark.parametrize("project", ["tables", "folders"], indirect=True)
def test_only_new_and_changed_items_are_computed(project):
    project.parameters["numbers"]["b"][4] = 6
    project.parameters["numbers"]["c"] = {1: 7}
    assert project.repro() == ["b/4", "c/1"]
    assert project.output() == project.from_nothing()
    project.parameters["numbers"]["a"][1] = 8
    assert project.repro() == ["a/1"]
    assert project.output() == project.from_nothing()


def test_removing_and_reordering_compute_nothing(project):
    numbers = project.parameters["numbers"]
    del numbers["b"][2]
    project.parameters["numbers"] = {"b": dict(reversed(numbers["b"].items())), "a": numbers["a"]}
    assert project.repro() == []
    assert project.output() == project.from_nothing()


def test_a_change_of_code_computes_everything_and_the_way_back_nothing(project):
    project.parameters["code"] = 2
    assert len(project.repro()) == 5
    project.parameters["code"] = 1
    project.parameters["numbers"]["a"][3] = 9
    assert project.repro() == ["a/3"], "items of a run before the last one were computed again"
    assert project.output() == project.from_nothing()


def test_a_killed_stage_loses_the_item_that_it_was_at(project):
    project.parameters["code"] = 2
    assert project.repro(KILL="b/1") == ["a/1", "a/2", "b/1"]
    assert project.repro() == ["b/1", "b/2", "b/3"]
    assert project.output() == project.from_nothing()


@pytest.mark.parametrize("project", ["tables", "folders"], indirect=True)
def test_a_failing_item_takes_no_other_with_it(project):
    """The folder faults/stage-whole-loss: the others are finished, and the next run of DVC takes them over."""
    project.parameters["code"] = 2
    assert len(project.repro(FAIL="b/1", REFUSE="a/2 b/3")) == 5
    assert (
        "squares: 3 of 5 numbers failed, the others are kept; all reasons are in data/items/squares.failures.csv; the "
        "first (and 2 more): a/2: 2 is no number that can be squared; give another." in project.said
    )
    assert "Traceback" not in project.said
    rows = (project.folder / "data/items/squares.failures.csv").read_text().splitlines()
    assert rows == [
        "item,reason,log",
        "a/2,a/2: 2 is no number that can be squared; give another.,",
        "b/1,a defect of the program (ValueError: 3 cannot be squared); its log is "
        "data/.unfinished/logs/squares.b-1.log,data/.unfinished/logs/squares.b-1.log",
        "b/3,b/3: 5 is no number that can be squared; give another.,",
    ]
    assert "ValueError: 3 cannot be squared" in (project.folder / "data/.unfinished/logs/squares.b-1.log").read_text()
    assert list(json.loads(project.output()["data/items/squares.json"])) == ["a/1", "b/2"]
    assert project.repro(FAIL="b/1") == ["a/2", "b/1", "b/3"], "items that were finished are computed again"
    assert project.repro() == ["b/1"]
    assert project.output() == project.from_nothing(), "the table of failures is still there, or a result differs"


def test_a_failing_new_item_leaves_those_of_the_last_run(project):
    project.parameters["numbers"]["c"] = {1: 7}
    assert project.repro(FAIL="c/1") == ["c/1"]
    assert project.repro(FAIL="c/1") == ["c/1"]
    del project.parameters["numbers"]["c"]
    assert project.repro() == []
    # DVC restores the last run, without the command: the table is still that of the command's last run.
    table = project.folder / "data/items/squares.failures.csv"
    assert table.read_text().startswith("item,reason,log\nc/1,")
    table.unlink()
    assert project.output() == project.from_nothing()


def test_what_an_interrupted_run_had_finished_is_dropped_when_it_is_saved(project):
    project.parameters["code"] = 2
    project.repro(KILL="b/1")
    project.repro()
    project.parameters["numbers"]["a"][1] = 8
    project.repro()
    kept = list((project.folder / "data/.unfinished/squares").glob("*.pickle"))
    assert len(kept) == 1, "results of a finished run, which DVC has saved, are still kept beside it"


@pytest.mark.parametrize("damage", ["truncated", "changed", "missing"])
def test_a_damaged_cache_means_computing(project, damage):
    for path in (project.folder / ".dvc/cache/files/md5").rglob("*"):
        if path.is_file():
            path.chmod(0o644)
            content = path.read_bytes()
            path.unlink()
            if damage != "missing":
                path.write_bytes(content[: len(content) // 2] if damage == "truncated" else b"[]" + content)
    project.parameters["numbers"]["a"][3] = 9
    assert project.repro() == ["a/1", "a/2", "a/3", "b/1", "b/2", "b/3"]
    assert project.output() == project.from_nothing()


def test_everything_is_computed_on_request(project):
    before = project.output()
    assert len(project.repro("--force", RECOMPUTE="1")) == 5
    assert project.output() == before


def test_a_clone_that_pulls_computes_only_what_is_new(project, tmp_path):
    remote = str(tmp_path / "remote")
    project.run("dvc", "remote", "add", "-d", "folder", remote)
    project.run("git", "add", "-A")
    project.run("git", "-c", "user.name=a", "-c", "user.email=a@b.c", "commit", "-qm", "all")
    assert project.run("dvc", "push").returncode == 0
    clone = Project(tmp_path / "clone", "tables")
    project.run("git", "clone", "-q", ".", str(clone.folder))
    assert clone.run("dvc", "pull").returncode == 0
    clone.parameters["numbers"]["a"][3] = 9
    assert clone.repro() == ["a/3"]
    assert clone.output() == clone.from_nothing()


@pytest.mark.parametrize("project", ["tables", "folders"], indirect=True)
def test_any_sequence_of_edits_ends_with_the_bytes_of_a_run_from_nothing(project):
    draw = random.Random(project.parameters["kind"])
    numbers = project.parameters["numbers"]
    for _ in range(6):
        edit = draw.choice(["add", "remove", "change", "code", "kill", "gc"])
        name = draw.choice(sorted(numbers))
        if edit == "add":
            numbers.setdefault(draw.choice("abcd"), {})[draw.randrange(1, 9)] = draw.randrange(9)
        elif edit == "remove" and len(numbers) > 1:
            del numbers[name]
        elif edit == "change":
            numbers[name][draw.choice(sorted(numbers[name]))] = draw.randrange(9)
        elif edit == "code":
            project.parameters["code"] = draw.randrange(3)
        elif edit == "gc":
            project.run("dvc", "gc", "-w", "-f")
        elif edit == "kill":
            project.parameters["code"] += 1
            project.repro(KILL=f"{name}/{sorted(numbers[name])[0]}")
        project.repro()
        assert project.output() == project.from_nothing(), edit
