"""Working copies of the repository in which the tests run real DVC, with real stages at scale tiny."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import sqlite3
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml

from tests.pipeline.declared import IN_GIT

# Durations differ from run to run, and no stage declares them.
UNCOUNTED = {"durations.json", ".durations.lock", ".gitignore"}
NO_RESULTS = ("data/raw/", "data/.unfinished/")


@dataclass(frozen=True)
class Repro:
    """One finished `dvc repro`."""

    code: int
    output: str

    @property
    def ran(self) -> list[str]:
        """Stages whose command was executed, in order."""
        return re.findall(r"^Running stage '(.+)':", self.output, flags=re.MULTILINE)

    @property
    def restored(self) -> list[str]:
        """Stages whose outputs came from DVC's record of earlier runs."""
        return re.findall(r"^Stage '(.+)' is cached", self.output, flags=re.MULTILINE)

    @property
    def computed(self) -> dict[str, tuple[int, int]]:
        """For every stage of items that was executed, how many of how many it computed."""
        found = re.findall(r"^(\S+): (\d+) of (\d+) \w+ to compute", self.output, flags=re.MULTILINE)
        return {stage: (int(computed), int(everything)) for stage, computed, everything in found}


class WorkingCopy:
    """A git repository with DVC in a folder of its own."""

    def __init__(self, root: Path) -> None:
        self.root = root

    def __truediv__(self, path: str) -> Path:
        return self.root / path

    def command(self, *arguments: str, **options) -> subprocess.CompletedProcess[str]:
        """Run a command in this copy."""
        return subprocess.run(
            arguments, cwd=self.root, capture_output=True, text=True, stdin=subprocess.DEVNULL, **options
        )

    def git(self, *arguments: str) -> str:
        """Run git and return what it prints."""
        done = self.command("git", "-c", "user.name=Test", "-c", "user.email=test@localhost", *arguments)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def commit(self, message: str) -> None:
        """Commit everything that is not ignored."""
        self.git("add", "--all")
        self.git("commit", "--quiet", "--allow-empty", "--message", message)

    def dvc(self, *arguments: str) -> str:
        """Run dvc and return what it prints; it must succeed."""
        done = self.command("python", "-m", "dvc", *arguments)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def repro(self, *arguments: str, succeed: bool = True, **environment: str) -> Repro:
        """Run `dvc repro`."""
        done = self.command("python", "-m", "dvc", "repro", *arguments, env=os.environ | environment)
        result = Repro(done.returncode, done.stdout + done.stderr)
        assert (result.code == 0) == succeed, result.output
        return result

    def parameters(self) -> dict:
        """Return params.yaml as written."""
        return yaml.safe_load((self / "params.yaml").read_text())

    def write_parameters(self, content: dict) -> None:
        """Replace params.yaml."""
        (self / "params.yaml").write_text(yaml.safe_dump(content, sort_keys=False))

    def fingerprints(self, *folders: str) -> dict[str, str]:
        """Return path -> SHA-256 of all files in ``folders`` (default: all results)."""
        found: dict[str, str] = {}
        for folder in folders or ("data", "models", "reports"):
            for path in sorted((self / folder).rglob("*")):
                name = str(path.relative_to(self.root))
                if path.is_file() and path.name not in UNCOUNTED and not name.startswith(NO_RESULTS):
                    found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
        return found

    def recorded_runs(self) -> int:
        """Return how many MLflow runs the database holds."""
        with sqlite3.connect(self / "mlflow.db") as database:
            return database.execute("select count(*) from runs").fetchone()[0]

    def copy(self, target: Path) -> WorkingCopy:
        """Copy everything; cached objects are never changed, so they are shared by hard links."""
        shutil.copytree(self / ".dvc/cache", target / ".dvc/cache", copy_function=_link)
        ignore = shutil.ignore_patterns("cache", "tmp")
        shutil.copytree(self / ".dvc", target / ".dvc", dirs_exist_ok=True, ignore=ignore)
        for entry in self.root.iterdir():
            if entry.name == ".dvc":
                continue
            if entry.is_dir():
                shutil.copytree(entry, target / entry.name)
            else:
                shutil.copy2(entry, target / entry.name)
        if (target / "mlflow.db").exists():
            _move_records(target / "mlflow.db", str(self.root), str(target))
        return WorkingCopy(target)


def _move_records(database: Path, old: str, new: str) -> None:
    """Tell a copied MLflow database where its files are now; it keeps absolute paths."""
    with sqlite3.connect(database) as connection:
        connection.execute("update experiments set artifact_location = replace(artifact_location, ?, ?)", (old, new))
        connection.execute("update runs set artifact_uri = replace(artifact_uri, ?, ?)", (old, new))


def _link(source: str, target: str) -> None:
    Path(target).hardlink_to(source)


def copy_of_sources(repository: Path, target: Path) -> WorkingCopy:
    """A new git repository with the files of ``repository`` that git knows or would accept."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"],
        cwd=repository,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    for name in filter(None, listed.split("\0")):
        if (repository / name).is_file() and name not in IN_GIT:
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(repository / name, target / name)
    copy = WorkingCopy(target)
    copy.git("init", "--quiet", "--initial-branch=main")
    copy.commit("Sources")
    return copy


@pytest.fixture
def fresh(repository, tmp_path) -> WorkingCopy:
    """The repository with nothing computed, for this test alone."""
    return copy_of_sources(repository, tmp_path / "fresh")


@pytest.fixture(scope="session")
def finished(repository, made_once, warm) -> WorkingCopy:
    """The whole pipeline at scale tiny, run once by real DVC and committed. Do not change it."""
    return WorkingCopy(made_once("finished", lambda folder: _run_tiny(repository, folder)))


def _run_tiny(repository: Path, target: Path) -> None:
    copy = copy_of_sources(repository, target)
    composed = copy.command("python", "-m", "tools.scales", "compose", "tiny")
    assert composed.returncode == 0, composed.stderr
    copy.repro()
    copy.commit("Results")


@pytest.fixture
def workspace(finished, tmp_path) -> WorkingCopy:
    """A copy of the finished pipeline, for this test alone."""
    return finished.copy(tmp_path / "repository")
