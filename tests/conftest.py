"""Shared by all rooms' tests."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import pipeline  # noqa: F401  (sets the thread counts before numpy is imported)

ROOT = Path(__file__).resolve().parent.parent

# Nothing that a test starts may leave this machine or depend on the caller's environment.
os.environ.update(DVC_NO_ANALYTICS="1", MLFLOW_DISABLE_TELEMETRY="true", DO_NOT_TRACK="1")
os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"


@pytest.fixture(scope="session")
def repository() -> Path:
    """Root of the repository under test."""
    return ROOT


@pytest.fixture
def empty_folder(tmp_path, monkeypatch) -> Path:
    """An empty working folder: where relative paths of `pipeline.records.paths` lead during the test."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="session")
def run_module():
    """Run ``python -m <module> ...`` in a folder, as a user would, and return the finished process."""

    def run(module: str, *arguments: str, folder: Path = ROOT, **options) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", module, *arguments]
        return subprocess.run(command, cwd=folder, capture_output=True, text=True, stdin=subprocess.DEVNULL, **options)

    return run
