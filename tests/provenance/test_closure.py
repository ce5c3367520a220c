"""The import closure holds what Python loads: against Python itself and against its module finder."""

import json
import subprocess
import sys
from modulefinder import ModuleFinder
from pathlib import Path

import pytest

from pipeline.provenance.closure import closure, data_files
from pipeline.records.errors import UserError

ROOT = Path(__file__).resolve().parents[2]


def found_by_python_s_finder(root: Path, module: str) -> set[str]:
    """All modules of the project that compiled code imports at any level."""
    finder = ModuleFinder(path=[str(root)])
    finder.import_hook(module)
    return {name for name in finder.modules if name.split(".")[0] == "pipeline"}


def loaded_by_python(modules: list[str]) -> set[str]:
    code = (
        "import importlib, json, sys\n"
        f"for name in {modules!r}: importlib.import_module(name)\n"
        "print(json.dumps([name for name in sys.modules if name.split('.')[0] == 'pipeline']))"
    )
    return set(json.loads(subprocess.check_output([sys.executable, "-c", code], cwd=ROOT, text=True).splitlines()[-1]))


def test_what_a_command_imports_is_found(repository):
    found = closure(repository.root, ["pipeline.grow.__main__"])
    assert set(found.modules) == {
        "pipeline",
        "pipeline.grow",
        "pipeline.grow.__main__",
        "pipeline.records",
        "pipeline.records.parameters",
        "pipeline.records.parameters.grow",
        "pipeline.records.parameters.section",
        "pipeline.records.parameters.shrink",
        "pipeline.shared",
        "pipeline.shared.rounding",
        "pipeline.shared.sums",
    }
    assert found.packages == {"numpy", "pydantic", "yaml"}


def test_python_s_finder_finds_the_same(repository):
    """But for imports for types, which it cannot tell."""
    repository.edit("pipeline/grow/__main__.py", "    from pipeline.others import Thing\n", "")
    expected = found_by_python_s_finder(repository.root, "pipeline.grow.__main__")
    assert set(closure(repository.root, ["pipeline.grow.__main__"]).modules) == expected


MAKERS = ("pipeline.provenance", "pipeline.stages.code")
COMMANDS = [
    "pipeline.prepare.__main__",
    "pipeline.merge.__main__",
    "pipeline.sample.__main__",
    "pipeline.reconstruct.__main__",
]


@pytest.mark.parametrize("command", COMMANDS)
def test_real_closures_are_between_what_python_loads_and_what_its_finder_finds(command):
    found = set(closure(ROOT, [command]).modules)
    at_first = loaded_by_python([command])
    assert len(at_first) > 10
    # What makes the fingerprints is in none of them.
    assert {name for name in at_first if not name.startswith(MAKERS)} <= found
    assert found <= found_by_python_s_finder(ROOT, command)


def test_all_modules_of_a_real_closure_load_no_others():
    found = set(closure(ROOT, ["pipeline.capture.__main__"]).modules)
    loaded = loaded_by_python(sorted(found - {"pipeline.capture.__main__"}))
    # One that a closure leaves out by design, with what it alone imports.
    assert {
        name for name in loaded - found if not name.startswith(("pipeline.stages.code", "pipeline.provenance"))
    } == set()


def test_only_sections_in_use_are_followed(repository):
    def parameters(sections):
        found = closure(repository.root, ["pipeline.grow.__main__"], sections)
        return {name.rpartition(".")[2] for name in found.modules if name.startswith("pipeline.records.parameters.")}

    assert parameters({"grow"}) == {"grow", "section"}
    assert parameters({"shrink"}) == {"shrink", "section"}  # by the name that params.yaml has
    assert parameters({"seed"}) == {"section"}
    assert parameters({"grow", "shrink"}) == {"grow", "section", "shrink"}


def test_a_section_that_another_module_imports_is_followed(repository):
    repository.edit("pipeline/shared/sums.py", "import json", "from pipeline.records.parameters import shrink")
    found = closure(repository.root, ["pipeline.grow.__main__"], {"grow"})
    assert "pipeline.records.parameters.shrink" in found.modules


def test_parameters_as_a_whole_are_all_of_them(repository):
    repository.edit("pipeline/shared/sums.py", "import json", "from pipeline.records import parameters")
    one = closure(repository.root, ["pipeline.grow.__main__"], {"grow"}).modules["pipeline.records.parameters"]
    repository.edit("pipeline/records/parameters/__init__.py", "LIMIT = 3", "LIMIT = 4")
    other = closure(repository.root, ["pipeline.grow.__main__"], {"grow"}).modules["pipeline.records.parameters"]
    assert one.digest != other.digest


def test_a_circle_of_imports_ends(repository):
    repository.edit("pipeline/shared/rounding.py", "def half", "from pipeline.shared import sums\n\n\ndef half")
    assert "pipeline.shared.sums" in closure(repository.root, ["pipeline.grow.__main__"]).modules


def test_a_module_that_is_no_python_is_told_with_its_line(repository):
    repository.edit("pipeline/shared/rounding.py", "return", "retrun")
    with pytest.raises(UserError) as error:
        closure(repository.root, ["pipeline.grow.__main__"])
    assert "rounding.py, line 3" in str(error.value)


def test_data_lie_beside_the_modules(repository):
    for name in (".hidden", "stale.pyc", "half.tmp", "__pycache__/sums.txt"):
        repository.write(f"pipeline/shared/{name}", "x")
    found = data_files(repository.root, closure(repository.root, ["pipeline.grow.__main__"]).modules)
    names = [file.relative_to(repository.root).as_posix() for file in found]
    assert names == ["pipeline/shared/deeper/table.txt", "pipeline/shared/palette.css"]
