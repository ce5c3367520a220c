"""A project with the layout of this one is shared through a folder, SSH and S3, with real servers on this machine.

DVC's own command line runs in this process: its imports are most of what a command costs.
"""

from __future__ import annotations

import contextlib
import io
import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.share import load_grasps
from tests.share.made_up import PARAMETERS, PINCH, write_tables
from tests.share.servers import s3, sshd

PIPELINE = """
stages:
  merge:
    cmd: python make.py merge
    deps: [make.py]
    params: [seed]
    outs: [data/merge]
  report:
    cmd: python make.py report
    deps: [make.py, data/merge]
    outs: [reports/index.html]
    metrics: [{reports/summary.json: {cache: false}}]
"""
# Notes that it ran; a table is the one in git that belongs to the seed.
MAKE = """
import os, shutil, sys
with open(os.environ["STAGES_THAT_RAN"], "a") as log:
    print(*sys.argv[1:], file=log)
if sys.argv[1] == "merge":
    seed = open("params.yaml").read().split("seed: ")[1].split()[0]
    shutil.copytree(f"made/{seed}/data/merge", "data/merge")
else:
    os.makedirs("reports", exist_ok=True)
    open("reports/index.html", "w").write("a page")
    open("reports/summary.json", "w").write('{"grasps": 8}')
"""
IGNORED = "/data\n/reports/index.html\n"


@dataclass(frozen=True)
class Shared:
    """What others know of the project."""

    address: str  # of its git repository
    owner: Path  # the working folder in which it was made
    settings: tuple[str, ...]  # of the remote


def git(folder: Path, *arguments: str) -> None:
    subprocess.run(["git", *arguments], cwd=folder, check=True, capture_output=True)


def dvc(folder: Path, *arguments: str, succeed: bool = True) -> str:
    """Run one dvc command in ``folder`` and return what it prints."""
    from dvc.cli import main

    printed = io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        code = main(list(arguments))
    assert (code == 0) == succeed, (arguments, printed.getvalue())
    return printed.getvalue()


def commit(folder: Path, message: str) -> None:
    git(folder, "add", "--all")
    git(folder, "commit", "--quiet", "--message", message)


def set_seed(folder: Path, seed: int) -> None:
    (folder / "params.yaml").write_text(yaml.safe_dump(PARAMETERS | {"seed": seed}))


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder, and a home, git and dvc of nobody."""
    folder = tmp_path_factory.mktemp("share")
    (folder / "home").mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HOME", str(folder / "home"))
        patch.setenv("GIT_CONFIG_NOSYSTEM", "1")
        for role in ("AUTHOR", "COMMITTER"):
            patch.setenv(f"GIT_{role}_NAME", "Test")
            patch.setenv(f"GIT_{role}_EMAIL", "test@localhost")
        for variable in ("DVC_GLOBAL_CONFIG_DIR", "DVC_SYSTEM_CONFIG_DIR", "DVC_SITE_CACHE_DIR"):
            patch.setenv(variable, str(folder / "home" / variable.lower()))
        for variable in [name for name in os.environ if name.startswith(("AWS_", "SSH_"))]:
            patch.delenv(variable)
        patch.setenv("STAGES_THAT_RAN", str(folder / "ran"))
        yield folder


@pytest.fixture(scope="module")
def owner(place):
    """The finished project, committed; its run-cache knows seed 2 too. Do not change it."""
    root = place / "owner"
    root.mkdir()
    for seed in (1, 2):
        write_tables(root / f"made/{seed}", learned=False)
    (root / "make.py").write_text(MAKE)
    (root / "dvc.yaml").write_text(PIPELINE)
    (root / ".gitignore").write_text(IGNORED)
    git(root, "init", "--quiet", "--initial-branch=main")
    dvc(root, "init", "--quiet")
    for seed in (2, 1):
        set_seed(root, seed)
        dvc(root, "repro")
    assert len((place / "ran").read_text().splitlines()) == 3  # the page follows from equal tables
    commit(root, "Results")
    return root


# Most of what S3 costs are imports, of the server and of Amazon's client.
SSH_SLOW, S3_SLOW = (pytest.param(kind, marks=pytest.mark.slow) for kind in ("ssh", "s3"))
everywhere = pytest.mark.parametrize("shared", ["folder", "ssh", S3_SLOW], indirect=True, scope="module")
slow_elsewhere = pytest.mark.parametrize("shared", ["folder", SSH_SLOW, S3_SLOW], indirect=True, scope="module")


@pytest.fixture(scope="module")
def shared(request, place, owner):
    """The project, pushed to a remote of each kind."""
    root = place / request.param
    root.mkdir()
    with contextlib.ExitStack() as stack:
        settings: tuple[str, ...] = ()
        if request.param == "folder":
            address = str(root / "storage")
        elif request.param == "ssh":
            address = stack.enter_context(sshd(root, place / "home"))
        else:
            address, endpoint = stack.enter_context(s3(place / "home"))
            settings = ("endpointurl", endpoint)
        copy = root / "owner"
        shutil.copytree(owner, copy)
        dvc(copy, "remote", "add", "--default", "lab", address)
        if settings:
            dvc(copy, "remote", "modify", "lab", *settings)
        commit(copy, "Name the remote")
        dvc(copy, "push", "--run-cache")
        git(copy, "clone", "--quiet", "--bare", ".", str(root / "project.git"))
        yield Shared(str(root / "project.git"), copy, settings)


@pytest.fixture
def ran(place):
    """Which stages' commands ran during the test."""
    (place / "ran").write_text("")
    return lambda: (place / "ran").read_text().splitlines()


@pytest.fixture
def clone(shared, place, tmp_path):
    """A colleague's fresh clone."""
    git(tmp_path, "clone", "--quiet", shared.address, "clone")
    return tmp_path / "clone"


def same(folder: Path, shared: Shared, path: Path) -> bool:
    return (folder / path).read_bytes() == (shared.owner / path).read_bytes()


@everywhere
def test_a_clone_restores_everything_and_runs_nothing(shared, clone, ran):
    dvc(clone, "repro", "--pull")
    assert ran() == []
    tables = [paths.merged_file(first) for first in PINCH]
    assert all(same(clone, shared, path) for path in [*tables, paths.REPORT_PAGE])
    assert "up to date" in dvc(clone, "status")
    assert "in sync" in dvc(clone, "status", "--cloud")


@slow_elsewhere
def test_one_object_s_grasps_can_be_pulled_alone(shared, clone):
    dvc(clone, "pull", "data/merge/cube.parquet")
    assert same(clone, shared, paths.merged_file("cube"))
    assert not (clone / paths.merged_file("plum")).exists()
    fetched = [path for path in (clone / ".dvc/cache/files").rglob("*") if path.is_file()]
    assert len(fetched) == 2  # the list of the folder and its table
    assert len(load_grasps(clone, first="cube")) == 4
    dvc(clone, "pull", "merge")  # and all others
    assert same(clone, shared, paths.merged_file("plum"))


@everywhere
def test_grasps_are_loaded_from_an_address_and_a_revision(shared, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    grasps = load_grasps(shared.address, "main", first="plum")
    assert grasps["object0"].tolist() == ["plum"] * 4
    assert list(tmp_path.iterdir()) == []


@slow_elsewhere
def test_another_project_gets_and_imports_grasps(shared, tmp_path):
    git(tmp_path, "init", "--quiet")
    dvc(tmp_path, "init", "--quiet")
    dvc(tmp_path, "get", shared.address, "data/merge/cube.parquet", "--out", "cube.parquet")
    dvc(tmp_path, "import", shared.address, "data/merge/plum.parquet", "--out", "plum.parquet")
    for name in PINCH:
        assert (tmp_path / f"{name}.parquet").read_bytes() == (shared.owner / paths.merged_file(name)).read_bytes()
    (dependency,) = yaml.safe_load((tmp_path / "plum.parquet.dvc").read_text())["deps"]
    assert dependency["repo"]["url"] == shared.address and len(dependency["repo"]["rev_lock"]) == 40
    dvc(tmp_path, "update", "plum.parquet.dvc")


@slow_elsewhere
def test_what_somebody_tried_before_is_not_computed_again(shared, clone, ran):
    dvc(clone, "pull", "--run-cache")
    set_seed(clone, 2)
    dvc(clone, "repro", "--pull")
    assert [line for line in ran() if line.startswith("merge")] == []
    made = clone / "made/2" / paths.merged_file("cube")
    assert (clone / paths.merged_file("cube")).read_bytes() == made.read_bytes()


# --- what can be missing


def refused(*arguments, **options) -> str:
    with pytest.raises(UserError) as error:
        load_grasps(*arguments, **options)
    text = str(error.value)
    assert "\n" not in text and text.endswith(".")
    return text


def test_data_that_were_never_pushed(owner, tmp_path):
    git(tmp_path, "clone", "--quiet", str(owner), "project")
    assert "ask its owner to name a DVC remote in .dvc/config" in refused(f"file://{tmp_path}/project")
    dvc(tmp_path / "project", "remote", "add", "--default", "lab", str(tmp_path / "storage"))
    commit(tmp_path / "project", "Name the remote")
    assert "cube.parquet of file://" in refused(f"file://{tmp_path}/project")


def test_an_address_or_a_revision_that_is_not_there(owner, tmp_path):
    assert "there is no git repository at" in refused(f"file://{tmp_path}/nothing")
    assert "has no revision v9" in refused(owner, "v9")
    git(tmp_path, "init", "--quiet", "--initial-branch=main", "plain")
    (tmp_path / "plain/readme").write_text("no data here")
    commit(tmp_path / "plain", "Begin")
    assert "is no project of two-object grasps" in refused(f"file://{tmp_path}/plain")


def test_a_revision_of_a_clone_comes_from_its_cache_whatever_lies_in_the_folder(owner, tmp_path):
    shutil.copytree(owner, tmp_path / "clone")
    shutil.rmtree(tmp_path / "clone/data")
    assert len(load_grasps(tmp_path / "clone", "main")) == 8
