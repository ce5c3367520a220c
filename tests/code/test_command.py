"""`python -m pipeline.code`, its check, and a stage that compares its own code with `code.yaml`."""

import ast
import shutil
from pathlib import Path

import pytest
import yaml

from pipeline.code.unseen import unseen
from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.stages.code import own_fingerprint

ROOT = Path(__file__).resolve().parents[2]
STAGES = """
stages:
  code: {cmd: python -m pipeline.code}
  capture: {cmd: python -m pipeline.capture, params: [seed, renderings, {code.yaml: [capture]}]}
  conditions: {cmd: python -m pipeline.evaluate.conditions, params: [conditions, {code.yaml: [conditions]}]}
"""


@pytest.fixture
def working_copy(empty_folder) -> Path:
    """The code itself, with a few stages."""
    shutil.copytree(ROOT / "pipeline", "pipeline", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("params.yaml", "constraints.txt"):
        shutil.copy(ROOT / name, name)
    Path("dvc.yaml").write_text(STAGES)
    return empty_folder


def test_the_file_has_a_line_for_every_command_and_the_same_bytes_again(working_copy, run_module):
    assert run_module("pipeline.code", folder=working_copy).returncode == 0
    before = paths.CODE_FILE.read_bytes()
    lines = yaml.safe_load(before)
    assert sorted(lines) == list(lines) == ["capture", "conditions", "settings"]
    settings = lines.pop("settings")
    assert all(isinstance(line, str) for line in lines.values())
    sections = set(yaml.safe_load((working_copy / "params.yaml").read_text()))
    assert set(settings) == sections - {"compute"} | {"all"}
    assert run_module("pipeline.code", folder=working_copy).returncode == 0
    assert paths.CODE_FILE.read_bytes() == before
    assert own_fingerprint("capture") == lines["capture"]


def test_digests_that_look_like_numbers_stay_texts(working_copy, monkeypatch):
    from pipeline.code import __main__

    monkeypatch.setattr(__main__, "code_lines", lambda root: {"a": "12345678", "b": "123e4567", "c": "0123"})
    __main__.write_lines()
    assert yaml.safe_load(paths.CODE_FILE.read_text()) == {"a": "12345678", "b": "123e4567", "c": "0123"}


def test_a_stage_with_other_code_than_recorded_is_refused(working_copy, run_module):
    with pytest.raises(UserError, match="dvc repro --force code"):
        own_fingerprint("capture")
    run_module("pipeline.code", folder=working_copy)
    sensor, trial = Path("pipeline/capture/sensor.py"), Path("pipeline/evaluate/trial.py")
    trial.write_text(trial.read_text() + "\nLIMIT = 1\n")
    own_fingerprint("capture")
    with pytest.raises(UserError, match="dvc repro --force code"):
        own_fingerprint("conditions")
    sensor.write_text(sensor.read_text() + "\n# a remark\n")
    own_fingerprint("capture")
    sensor.write_text(sensor.read_text() + "\nLIMIT = 1\n")
    with pytest.raises(UserError, match="dvc repro --force code"):
        own_fingerprint("capture")
    paths.CODE_FILE.write_text("half: [")
    with pytest.raises(UserError, match="dvc repro --force code"):
        own_fingerprint("capture")


def test_bad_input_ends_in_one_sentence(working_copy, run_module):
    Path("dvc.yaml").write_text("stages: {capture: {cmd: python -m pipeline.capture, params: [seed]}}\n")
    done = run_module("pipeline.code", folder=working_copy)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert "capture" in done.stderr
    assert not paths.CODE_FILE.exists()


def test_the_check_passes_here_and_refuses_a_dynamic_import(working_copy, run_module):
    assert run_module("pipeline.code", "--check", folder=working_copy).returncode == 0
    file = Path("pipeline/capture/sensor.py")
    lines = len(file.read_text().splitlines())
    file.write_text(file.read_text() + "from importlib import import_module\n")
    done = run_module("pipeline.code", "--check", folder=working_copy)
    assert done.returncode == 2
    assert f"{file}, line {lines + 1}:" in done.stderr


@pytest.mark.parametrize(
    "text",
    [
        "import importlib",
        "import importlib.util",
        "from importlib import import_module as load",
        "from importlib.util import spec_from_file_location",
        "from importlib.machinery import SourceFileLoader",
        "import importlib.metadata\nimportlib.import_module('a')",
        "def f():\n    import runpy",
        "import pkgutil",
        "from builtins import exec as run",
        "__import__('a')",
        "exec('import a')",
        "run = eval",
        "compile('import a', '', 'exec')",
        "print(__doc__)",
        "text = Thing.__doc__",
    ],
)
def test_what_fingerprints_do_not_see_is_found(text):
    assert list(unseen(ast.parse(text)))


@pytest.mark.parametrize(
    "text",
    [
        "import importlib.metadata\nimportlib.metadata.distributions()",
        "from importlib import metadata",
        "from importlib.metadata import version",
        "from importlib.util import find_spec",
        "import re\npattern = re.compile('a')",
        "network.eval()",
        "database.exec('select 1')",
        "parser = ArgumentParser(description=__doc__)",
        "parser = ArgumentParser(description=__doc__.splitlines()[0])",
        "def f():\n    import a",
    ],
)
def test_what_they_see_is_left_alone(text):
    assert not list(unseen(ast.parse(text)))
