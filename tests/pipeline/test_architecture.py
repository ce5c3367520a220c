"""Who may import whom, and the page that says so."""

import ast
import re
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/architecture.md").read_text()
ROOMS = sorted(path.parent.name for path in ROOT.glob("pipeline/*/__init__.py"))
READERS = {"view", "replay", "plan", "share", "score", "propose"}
STAGES = {path.parent.name for path in ROOT.glob("pipeline/*/__main__.py")} - READERS
# Packages that take long to load, or that only a cluster needs: a module that runs without them imports them where it
# needs them, or imports there another module that loads one of them.
LATE = {
    "curobo",
    *(
        "coacd",
        "coal",
        "DracoPy",
        "h5py",
        "joblib",
        "mani_skill",
        "mlflow",
        "mujoco",
        "open3d",
        "pinocchio",
        "sapien",
        "scipy",
        "sqlalchemy",
    ),
    *("torch", "trimesh", "viser", "warp"),
    *("dvc", "dvc_data"),
    *("onnxruntime", "pi_heif"),
    *("cloudpickle", "dask", "distributed", "threadpoolctl"),
}
OUTSIDE = {"seqgrasp", "tools", "tests", "benchmarks", "examples"}


def named_by(nodes: Iterable[ast.AST]) -> Iterator[str]:
    """Yield what those of the nodes name that are imports, as `package.module`."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0 and node.module, "an import by a relative name"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def imported(file: Path) -> Iterator[str]:
    """Yield the modules that a file names in imports at any level, as `package.module`."""
    yield from named_by(ast.walk(ast.parse(file.read_text())))


def arrows(folder: str) -> set[tuple[str, str]]:
    """Return (file below ``folder``, imported module) for all Python files in it."""
    base = ROOT / folder
    return {(str(file.relative_to(base)), name) for file in base.rglob("*.py") for name in imported(file)}


IN_PIPELINE = arrows("pipeline")
BETWEEN_ROOMS = {
    (file, name) for file, name in IN_PIPELINE if name.startswith("pipeline.") and name.split(".")[1] in ROOMS
}


def broken(sources: set[str], targets: set[str]) -> list[tuple[str, str]]:
    """Return imports from a file of ``sources`` to another room, one of ``targets``."""
    return sorted(
        (file, name)
        for file, name in BETWEEN_ROOMS
        if file.split("/")[0] in sources and name.split(".")[1] in targets - {file.split("/")[0]}
    )


def users(package: str) -> set[str]:
    return {file for file, name in IN_PIPELINE if name.split(".")[0] == package}


def test_the_page_describes_every_room_in_the_words_of_its_docstring():
    """To mend: copy the first line of ``pipeline/<room>/__init__.py`` into the room's row."""
    rows = dict(re.findall(r"^\| `(\w+)` \| (.+) \|$", PAGE, re.MULTILINE))
    own = {
        room: (ast.get_docstring(ast.parse((ROOT / f"pipeline/{room}/__init__.py").read_text())) or "").splitlines()[0]
        for room in ROOMS
    }
    assert rows == own


def test_stages_do_not_import_each_other():
    assert broken(STAGES, STAGES) == []


def test_only_readers_import_readers():
    assert broken(set(ROOMS) - READERS, READERS) == []


def test_records_stands_below_all_other_rooms():
    assert {name.rpartition(".")[0] for _, name in broken({"records"}, set(ROOMS))} <= {"pipeline.stages.seeds"}
    assert not [name for file, name in BETWEEN_ROOMS if file == "stages/seeds.py"]


@pytest.mark.parametrize(
    ("folder", "outside"),
    [("pipeline", OUTSIDE), ("seqgrasp", OUTSIDE - {"seqgrasp"}), ("tools", {"tests", "examples"})],
)
def test_nothing_imports_what_stands_around_it(folder, outside):
    assert [(file, name) for file, name in arrows(folder) if name.split(".")[0] in outside] == []


@pytest.mark.parametrize(
    ("package", "rooms"),
    [
        ("mlflow", {"track"}),
        ("viser", {"pictures", "view", "replay"}),
        ("sapien", {"physics", "replay"}),
        ("mujoco", {"physics", "hand"}),
    ],
)
def test_a_package_is_known_to_its_rooms_alone(package, rooms):
    assert {file.split("/")[0] for file in users(package)} <= rooms


def test_only_physics_and_the_camera_of_a_replay_know_the_simulator():
    elsewhere = {file for file in users("sapien") | users("mani_skill") if not file.startswith("physics/")}
    assert elsewhere == {"replay/sapien_camera.py"}


def test_outside_of_physics_mujoco_only_reads_its_own_format():
    assert {file for file in users("mujoco") if not file.startswith("physics/")} == {"hand/mjcf.py"}


def test_the_page_names_everything_that_is_there():
    known = {path.name for path in ROOT.iterdir() if path.is_dir() and not path.name.startswith(".")}
    beside = {"site", "plan", "replays", "grasps", "scores", "dvc_plots", "mlartifacts", "shared", "models", "reports"}
    named = set(re.findall(r"`(\w+)/", PAGE))
    assert {name for name in known - beside if not name.endswith((".egg-info", "__pycache__"))} <= named


def module_file(name: str) -> Path | None:
    """Return the file of a module of the pipeline; of a name in a module, that of the module."""
    parts = name.split(".")
    files = (ROOT.joinpath(*parts[:count]).with_suffix(".py") for count in (len(parts), len(parts) - 1))
    return next((file for file in files if file.is_file()), None)


@cache
def loads_late_package(file: Path) -> bool:
    """Tell whether a module loads one of ``LATE`` as soon as it is imported, itself or through others."""
    seen, waiting = set(), [file]
    while waiting:
        if (current := waiting.pop()) in seen:
            continue
        seen.add(current)
        for name in named_by(node for node in ast.parse(current.read_text()).body):
            if name.split(".")[0] in LATE:
                return True
            waiting += [found] if (found := module_file(name)) else []
    return False


def late_imports(file: Path) -> set[str]:
    tree = ast.parse(file.read_text())
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    return set(named_by(node for function in functions for node in ast.walk(function)))


@pytest.mark.parametrize("room", ROOMS)
def test_only_what_is_slow_to_load_is_imported_inside_functions(room):
    """A command checks its parameters before it imports what it computes with; everything else imports at the top."""
    for file in sorted((ROOT / "pipeline" / room).glob("*.py")):
        if '\nif __name__ == "__main__":' in file.read_text():
            continue
        for name in late_imports(file):
            own = module_file(name) if name.startswith("pipeline.") else None
            assert name.split(".")[0] in LATE or (own and loads_late_package(own)), f"{file} imports {name} late"
