"""Set-ups as they are: real DVC in clones at other places and under other environments; docs/trust.md has the list."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

PLACES = ["with spaces and ümläuts", "parent", "worktree", "shallow", "crlf"]
ENVIRONMENTS: dict[str, Callable[[Path], dict[str, str]]] = {
    "C locale": lambda folder: {"LANG": "C", "LC_ALL": "C"},
    "locale that is not installed": lambda folder: {"LC_ALL": "de_DE.ISO-8859-1"},
    "conda and PYTHONPATH": lambda folder: {"CONDA_PREFIX": "/opt/conda", "PYTHONPATH": str(folder / "elsewhere")},
    "tracking elsewhere": lambda folder: {"MLFLOW_TRACKING_URI": "http://127.0.0.1:9"},
    "empty home, no identity": lambda folder: {"HOME": str(folder / "home"), "GIT_CONFIG_GLOBAL": "/dev/null"},
}


def git(folder: Path, *arguments: str) -> None:
    identity = ("-c", "user.name=Test", "-c", "user.email=test@localhost")
    subprocess.run(["git", *identity, *arguments], cwd=folder, check=True, capture_output=True)


def clone(repository: Path, place: str, folder: Path) -> Path:
    """Return a clone of what is committed, at a place of its own."""
    source = f"file://{repository}"
    if place == "parent":
        # A folder of somebody's own repository: its files are tracked there, and it has no .git itself.
        git(folder, "init", "-q", "mine")
        git(folder, "clone", "-q", "--depth", "1", source, "mine/grasping")
        subprocess.run(["rm", "-rf", str(folder / "mine/grasping/.git")], check=True)
        git(folder / "mine", "add", "-A")
        git(folder / "mine", "commit", "-qm", "with the grasping project")
        return folder / "mine/grasping"
    options = {"shallow": ["--depth", "1"], "crlf": ["-c", "core.autocrlf=true"]}.get(place, [])
    git(folder, "clone", "-q", *options, source, place)
    if place == "worktree":
        git(folder / place, "worktree", "add", "-q", "../another", "-b", "another")
        return folder / "another"
    return folder / place


def repro(project: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the first stage through DVC: the place and the environment reach it through git, DVC, imports and writing."""
    (project / "code.yaml").unlink(missing_ok=True)
    done = subprocess.run(
        [sys.executable, "-m", "dvc", "repro", "code"],
        cwd=project,
        env={key: value for key, value in os.environ.items() if key != "PYTHONPATH"} | environment,
        capture_output=True,
        text=True,
        errors="replace",
        umask=0o077,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert (project / "code.yaml").is_file() and "Traceback" not in done.stdout + done.stderr
    return done


@pytest.mark.parametrize("place", PLACES)
def test_places(repository, tmp_path, place):
    project = clone(repository, place, tmp_path)
    repro(project)
    assert b"\r" not in (project / "dev").read_bytes()
    shown = subprocess.run(["./dev", "--help"], cwd=project, capture_output=True, text=True)
    assert shown.returncode == 0 and "add-object" in shown.stdout


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_environments(repository, tmp_path, name):
    (tmp_path / "home").mkdir()
    (tmp_path / "elsewhere/pipeline").mkdir(parents=True)
    (tmp_path / "elsewhere/pipeline/__init__.py").write_text("raise ImportError('another package of this name')")
    repro(clone(repository, "shallow", tmp_path), **ENVIRONMENTS[name](tmp_path))
