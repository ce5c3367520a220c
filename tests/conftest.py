"""Shared by all rooms' tests."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from filelock import FileLock

import pipeline  # noqa: F401  (sets the thread counts before numpy is imported)
from tests.pipeline import warm as warm_python

ROOT = Path(__file__).resolve().parent.parent

# Nothing that a test starts may leave this machine or depend on the caller's environment.
os.environ.update(DVC_NO_ANALYTICS="1", MLFLOW_DISABLE_TELEMETRY="true", DO_NOT_TRACK="1")
os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let `--slow` run everything."""
    parser.addoption("--slow", action="store_true", help="run the tests that are marked slow, too")


def pytest_configure(config: pytest.Config) -> None:
    """Leave slow tests out of a run of everything only: whoever names files or markers gets what was named."""
    config.option.slow |= config.args_source is config.ArgsSource.ARGS or bool(config.option.markexpr)


def pytest_report_header(config: pytest.Config) -> str | None:
    """Say what is left out."""
    return None if config.option.slow else "without slow tests; --slow runs them, too"


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out slow tests unless they are wanted, and order the others."""
    if not config.option.slow:
        left_out = [item for item in items if item.get_closest_marker("slow")]
        items[:] = [item for item in items if not item.get_closest_marker("slow")]
        config.hook.pytest_deselected(items=left_out)
    _dearest_first(items)


def _dearest_first(items: list[pytest.Item]) -> None:
    """Put files with slow tests first: one that began last would leave the other processes of `./dev test` idle.

    The first of those that need the run of the whole pipeline makes it; the others would wait, and come after all other
    slow ones, or last if nothing in them is slow.
    """

    def file_of(item: pytest.Item) -> str:
        return item.nodeid.split("::")[0]

    slow = {file_of(item) for item in items if item.get_closest_marker("slow")}
    waiting = dict.fromkeys(file_of(item) for item in items if "finished" in getattr(item, "fixturenames", ()))
    first = next((name for name in waiting if not slow or name in slow), None)

    def place(item: pytest.Item) -> int:
        name = file_of(item)
        if name == first:
            return 0
        if name in slow:
            return 2 if name in waiting else 1
        return 4 if name in waiting else 3

    items.sort(key=place)


@pytest.fixture(scope="session")
def repository() -> Path:
    """Root of the repository under test."""
    return ROOT


@pytest.fixture(scope="session")
def made_once(tmp_path_factory) -> Callable[[str, Callable[[Path], object]], Path]:
    """Return a folder that all processes of a run of the tests share: the first to ask makes it, the others wait."""
    shared = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared = shared.parent

    def folder(name: str, make: Callable[[Path], object]) -> Path:
        with FileLock(shared / f"{name}.lock"):
            if not (shared / f"{name}.done").exists():
                make(shared / name)
                (shared / f"{name}.done").touch()
        return shared / name

    return folder


@pytest.fixture(scope="session")
def warm(tmp_path_factory) -> Iterator[None]:
    """Let `python` be the stand-in of :mod:`tests.pipeline.warm`, for everything that is started by that name."""
    folder = tmp_path_factory.mktemp("warm")
    with warm_python.start(folder) as server, pytest.MonkeyPatch.context() as patch:
        patch.setenv("PATH", str(folder), prepend=os.pathsep)
        yield
        server.communicate()


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
