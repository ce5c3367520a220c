"""A line of `code.yaml` changes with everything on which the results of its stages depend, and with nothing else."""

from pathlib import Path

import pytest

from pipeline.provenance.closure import stated_sections
from pipeline.provenance.lines import code_line, code_lines, pins
from pipeline.records.errors import UserError

ROOT = Path(__file__).resolve().parents[2]
PARAMETERS = "pipeline/records/parameters/__init__.py"


def grow(repository) -> str:
    return code_lines(repository.root)["grow"]


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("pipeline/grow/__main__.py", "# late", "# in time"),
        ("pipeline/grow/__main__.py", "Grow.", "Grow it."),
        ("pipeline/grow/__main__.py", "import torch", "import pandas"),
        ("pipeline/grow/__init__.py", "Growing.", "Growth."),
        ("pipeline/others/__init__.py", "pass", "x = 1"),
        ("pipeline/others/picture.svg", "<svg/>", "<svg></svg>"),
        ("pipeline/records/parameters/grow.py", "How fast.", "How fast, 1/s."),
        ("pipeline/records/parameters/shrink.py", "0.1", "0.2"),
        (PARAMETERS, "Seed.", "The seed."),
        ("pipeline/grow/__main__.py", '"""shrink"""', '"""Shrink."""'),
        (PARAMETERS, "LIMIT = 3", "LIMIT = 4"),  # of a check
        (PARAMETERS, 'ValueError("no")', 'ValueError("never")'),
        (PARAMETERS, "return self.grow, self.validate_", "return self.validate_, self.grow"),  # of another section too
        (PARAMETERS, 'Field(alias="shrink")', 'Field(alias="shrink", frozen=True)'),
        (PARAMETERS, "grow: GrowParameters\n", "grow: GrowParameters\n    added: dict[str, int]\n"),
        ("constraints.txt", "trimesh==4.0", "trimesh==4.1"),
        ("constraints.txt", "torch==2.6", "torch==2.7"),
        ("params.yaml", "rate: 0.5", "rate: 0.6"),
        ("dvc.yaml", "--item", "--thing"),
        ("dvc.yaml", "grow, {code", "shrink, {code"),
    ],
)
def test_what_no_result_depends_on_leaves_the_line(repository, file, old, new):
    before = grow(repository)
    repository.edit(file, old, new)
    assert grow(repository) == before


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("pipeline/grow/__main__.py", '["grow"]', '["growth"]'),
        ("pipeline/shared/rounding.py", "/ 2", "/ 3"),  # imported inside a function, by an import of another one
        ("pipeline/shared/sums.py", "import json", "import json\nimport trimesh"),
        ("pipeline/shared/palette.css", "red", "blue"),
        ("pipeline/shared/deeper/table.txt", "3", "4"),
        ("pipeline/records/parameters/grow.py", "gt=0", "ge=0"),
        ("pipeline/records/parameters/section.py", "pass", "x = 1"),
        (PARAMETERS, "getattr(Parameters(), name)", "getattr(Parameters(), name, None)"),
        (PARAMETERS, "grow: GrowParameters\n", "grow: GrowParameters = GrowParameters()\n"),
        ("constraints.txt", "numpy==2.0", "numpy==2.1"),
        ("constraints.txt", "PyYAML==6.0", "PyYAML==6.1"),
        ("pipeline/grow/__main__.py", '["seed", f"grow.{item}"]', '["seed", f"grow.{item}", "shrink"]'),
    ],
)
def test_what_a_result_depends_on_changes_the_line(repository, file, old, new):
    before = grow(repository)
    repository.edit(file, old, new)
    assert grow(repository) != before


def test_a_file_that_comes_or_goes_changes_the_line(repository):
    before = grow(repository)
    repository.write("pipeline/shared/new.json", "{}")
    assert grow(repository) != before
    (repository.root / "pipeline/shared/new.json").unlink()
    assert grow(repository) == before


def test_the_place_of_the_repository_does_not_count(repository, tmp_path_factory):
    from shutil import copytree

    other = tmp_path_factory.mktemp("other") / "copy"
    copytree(repository.root, other)
    assert code_lines(other) == code_lines(repository.root)


def test_a_command_that_shows_descriptions_depends_on_them(repository):
    repository.edit("pipeline/shared/sums.py", "import json", "fields = object.model_fields")
    before = grow(repository)
    repository.edit("pipeline/records/parameters/grow.py", "How fast.", "How fast, 1/s.")
    assert grow(repository) != before


def test_settings_are_all_values_but_those_of_compute(repository):
    def settings():
        return code_lines(repository.root)["settings"]

    before = settings()
    repository.edit("params.yaml", "workers: 2", "workers: 4")
    repository.edit("params.yaml", "seed: 1\n", "# the seed\nseed:   1\n")
    assert settings() == before
    repository.edit("params.yaml", "rate: 0.5", "rate: 0.6")
    after = settings()
    assert {name for name in before if after[name] != before[name]} == {"grow", "all"}


def test_a_command_that_states_no_sections_may_read_all(repository):
    repository.edit("pipeline/grow/__main__.py", "def sections", "def other")
    before = grow(repository)
    repository.edit("pipeline/records/parameters/shrink.py", "    pass", "    x = 1")
    assert grow(repository) != before


def test_sections_may_be_stated_in_another_module(repository):
    repository.edit(
        "pipeline/grow/__main__.py", "def sections", "from pipeline.shared.inputs import sections\n\ndef other"
    )
    repository.write("pipeline/shared/inputs.py", "def sections():\n    return ['grow']\n")
    before = grow(repository)
    repository.edit("pipeline/records/parameters/shrink.py", "    pass", "    x = 1")
    assert grow(repository) == before
    repository.edit("pipeline/shared/inputs.py", "['grow']", "['shrink']")
    middle = grow(repository)
    repository.edit("pipeline/records/parameters/shrink.py", "    x = 1", "    x = 2")
    assert len({before, middle, grow(repository)}) == 3


REAL = {
    "pipeline.prepare.__main__": {},
    "pipeline.synthesize.__main__": {"style": "pinch"},
    "pipeline.merge.__main__": {},
    "pipeline.train.__main__": {},
    "pipeline.sample.__main__": {"source": "reconstructed"},
}


@pytest.mark.parametrize("module", REAL)
def test_stated_sections_hold_those_that_the_function_returns(module):
    from importlib import import_module
    from inspect import signature

    function = import_module(module).sections
    returned = function(**{name: REAL[module].get(name, "x") for name in signature(function).parameters})
    stated = stated_sections(ROOT, module)
    assert {name.split(".")[0] for name in returned} <= stated
    assert "compute" not in stated and "*" not in stated


def test_every_command_has_a_line_and_no_other(repository):
    lines = code_lines(repository.root)
    assert list(lines) == ["grow", "settings"]
    assert len(lines["grow"]) >= 10 and int(lines["grow"], 16) >= 0
    assert code_line(repository.root, "grow") == lines["grow"]
    with pytest.raises(UserError):
        code_line(repository.root, "shrink")


def test_stages_that_run_the_same_may_share_a_line(repository):
    before = code_lines(repository.root)
    text = (repository.root / "dvc.yaml").read_text()
    again = (
        "  again:\n    cmd: python -m pipeline.grow --again\n    params: [shrink, {code.yaml: [grow, settings.all]}]\n"
    )
    (repository.root / "dvc.yaml").write_text(text + again)
    assert code_lines(repository.root) == before


@pytest.mark.parametrize(
    ("file", "old", "new", "said"),
    [
        ("dvc.yaml", ", {code.yaml: [grow]}", "", "stage grow"),
        ("dvc.yaml", "[grow]}", "[grow, more]}", "stage grow"),
        ("dvc.yaml", "./build\n", "python -m pipeline.others\n    params: [{code.yaml: [grow]}]\n", "stage elsewhere"),
        ("dvc.yaml", "pipeline.grow", "pipeline.gorw", "pipeline.gorw"),
        ("dvc.yaml", "stages:", "stages: [", "dvc.yaml"),
        ("params.yaml", "seed: 1", "seed: [", "params.yaml"),
        ("constraints.txt", "numpy==2.0\n", "", "numpy"),
    ],
)
def test_what_does_not_fit_is_one_sentence(repository, file, old, new, said):
    repository.edit(file, old, new)
    with pytest.raises(UserError) as error:
        code_lines(repository.root)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_real_pins_are_those_of_what_is_installed():
    """By the record that pip keeps of what every distribution brought."""
    from importlib.metadata import packages_distributions

    known = packages_distributions()
    for package in ("cv2", "numpy", "PIL", "sapien", "torch", "warp", "yaml"):
        (pin,) = pins(ROOT, [package])
        assert pin.split("==")[0].lower() in {name.lower() for name in known[package]}
