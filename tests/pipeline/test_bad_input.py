"""Bad input to the commands of all stages: one sentence, at once, and nothing half-written."""

import os
import runpy
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
import yaml

from pipeline.provenance.lines import code_lines
from tests.pipeline.conftest import WorkingCopy
from tests.pipeline.declared import HEAVY

STAYS = {"--style", "--source"}
COMMANDS = {  # by hand, as a run of all items reads more
    "prepare": ("--object", "cube"),
    "synthesize": ("--style", "pinch", "--object", "cube"),
    "validate": ("--style", "side", "--object", "soup_can"),
    "merge": ("--object", "cube"),
    "train": (),
    "sample": ("--source", "learned", "--object", "cube"),
    "evaluate": ("--source", "synthesized", "--object", "cube"),
    "evaluate.conditions": ("--series", "synthesized-placement-sapien"),
    "capture": ("--name", "demo"),
    "reconstruct": ("--capture", "demo"),
    "report": (),
    "track": (),
}
OF_ALL_ITEMS = {
    room: tuple(word for pair in zip(words[::2], words[1::2], strict=True) if pair[0] in STAYS for word in pair)
    for room, words in COMMANDS.items()
}
each_stage = pytest.mark.parametrize("room", COMMANDS)


@pytest.fixture(scope="module")
def fingerprints(repository) -> str:
    """The content of code.yaml."""
    return yaml.safe_dump(code_lines(repository))


@pytest.fixture
def sandbox(repository, tmp_path, fingerprints) -> WorkingCopy:
    """The code, the parameters of the repository, which a test may change, and nothing computed."""
    folder = tmp_path / "repository"
    (folder / "data/raw").mkdir(parents=True)
    for name in ("pipeline", "tools", "dvc.yaml", "constraints.txt"):
        (folder / name).symlink_to(repository / name)
    (folder / "code.yaml").write_text(fingerprints)
    shutil.copy(repository / "params.yaml", folder)
    return WorkingCopy(folder)


@pytest.fixture
def run(sandbox, monkeypatch, capfd):
    """Run a stage's command in the sandbox, in this process: what it loads is loaded once for all tests."""

    def in_this_process(room: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        name = f"pipeline.{room}"
        spec = find_spec(f"{name}.__main__" if find_spec(name).submodule_search_locations else name)
        monkeypatch.chdir(sandbox.root)
        monkeypatch.setattr(sys, "argv", [name, *arguments])
        capfd.readouterr()
        with pytest.raises(SystemExit) as end:
            runpy.run_path(spec.origin, run_name="__main__")
        return subprocess.CompletedProcess(sys.argv, end.value.code, *capfd.readouterr())

    return in_this_process


def run_and_tell_what_was_loaded(repository: Path, sandbox: WorkingCopy, room: str, *arguments: str):
    """Run a stage's command as a user does; print the heavy packages that it loaded as the last line of stdout."""
    code = (
        "import atexit, runpy, sys\n"
        f"atexit.register(lambda: print('LOADED', *[name for name in {sorted(HEAVY)!r} if name in sys.modules]))\n"
        f"sys.argv = ['pipeline.{room}', *{list(arguments)!r}]\n"
        f"runpy.run_module('pipeline.{room}', run_name='__main__', alter_sys=True)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(repository)}
    return sandbox.command(sys.executable, "-c", code, env=environment)


def assert_one_sentence(done, *words: str) -> None:
    assert done.returncode == 2, done.stderr
    lines = [line for line in done.stderr.splitlines() if line and "%|" not in line]  # but progress bars
    assert len(lines) == 1, done.stderr
    for word in words:
        assert word in done.stderr


@each_stage
def test_every_command_explains_itself(run, room):
    done = run(room, "--help")
    assert done.returncode == 0
    assert f"python -m pipeline.{room}" in done.stdout


@pytest.mark.slow
@each_stage
def test_a_misspelt_parameter_is_found_before_anything_heavy_loads(repository, sandbox, room):
    content = sandbox.parameters()
    content["synthesize"]["pinch"]["chainz"] = 5
    sandbox.write_parameters(content)
    done = run_and_tell_what_was_loaded(repository, sandbox, room, *COMMANDS[room])
    assert_one_sentence(done, "params.yaml: synthesize.pinch.chainz: unknown parameter (misspelt?)")
    assert done.stdout.split() == ["LOADED"]
    assert not (sandbox / "data/prepare").exists()


@each_stage
def test_a_value_out_of_range_is_named(sandbox, run, room):
    content = sandbox.parameters()
    content["physics"]["object_friction"] = -0.5
    sandbox.write_parameters(content)
    assert_one_sentence(run(room, *COMMANDS[room]), "physics.object_friction", "greater than or equal to 0")


@pytest.mark.parametrize("room", [room for room in COMMANDS if room != "prepare"])
def test_missing_inputs_are_named_with_the_command_that_makes_them(sandbox, run, room):
    for arguments in (COMMANDS[room], OF_ALL_ITEMS[room]):
        done = run(room, *arguments)
        assert_one_sentence(done, "is missing", "dvc repro")
        left = [path for path in (sandbox / "data").rglob("*") if path.is_file()]
        assert all(path.name.endswith(".failures.csv") for path in left), left  # which items failed, and why


def test_an_unknown_object_is_answered_with_the_known_ones(sandbox, run):
    done = run("prepare", "--object", "dragon")
    assert_one_sentence(done, "no object 'dragon'", "cube, plum, slender_cylinder, soup_can")


@pytest.mark.parametrize("room", [room for room, own in COMMANDS.items() if "--object" in own and room != "prepare"])
def test_an_unprepared_object_is_named(sandbox, run, room):
    done = run(room, *COMMANDS[room][:-1], "dragon")
    assert_one_sentence(done, "dragon")


def test_a_style_that_names_an_unknown_object_stops_every_stage(sandbox, run):
    content = sandbox.parameters()
    content["styles"]["side"].append("dragon")
    sandbox.write_parameters(content)
    assert_one_sentence(run("merge", "--object", "cube"), "styles.side lists the unknown object 'dragon'")


@pytest.mark.parametrize("content", [None, "this is no mesh"])
def test_a_mesh_file_that_is_missing_or_none_is_named(sandbox, run, content):
    parameters = sandbox.parameters()
    parameters["meshes"]["mug"] = {"file": "data/raw/mug.stl"}
    sandbox.write_parameters(parameters)
    if content:
        (sandbox / "data/raw/mug.stl").write_text(content)
    assert_one_sentence(run("prepare", "--object", "mug"), "data/raw/mug.stl")
    assert list((sandbox / "data").glob("prepare/*")) == []


def test_a_file_in_the_way_of_the_output_is_named(sandbox, run):
    (sandbox / "data/prepare").write_text("a file, not a folder")
    assert_one_sentence(run("prepare", "--object", "cube"), "cannot write data/prepare/cube")
    assert (sandbox / "data/prepare").read_text() == "a file, not a folder"
