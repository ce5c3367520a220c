"""`dvc.yaml` tells the truth: a forgotten dependency or parameter is a stale result that nobody notices."""

import ast
import re
import subprocess
from pathlib import Path

import pytest
import yaml

from tests.pipeline.declared import HEAVY, declared_stages, true_imports

ROOT = Path(__file__).resolve().parents[2]
STAGES = declared_stages(ROOT)
ROOMS = sorted({stage.room for stage in STAGES})
SHARED = {"compute", "energy", "hand", "motion", "pairing", "physics", "pictures", "records"}
SPLIT = {"evaluate", "train"}
PUBLISHED = {"reports/learned_objectives.csv", "reports/learned_ablation.csv"}  # by scripts of benchmarks/

each_stage = pytest.mark.parametrize("stage", STAGES, ids=lambda stage: stage.name)
each_room = pytest.mark.parametrize("room", ROOMS)


def tree_of(path: Path) -> ast.Module:
    return ast.parse((ROOT / path).read_text())


def files_of(room: str) -> list[Path]:
    return sorted((ROOT / "pipeline" / room).glob("*.py"))


@each_stage
def test_code_dependencies_are_the_true_imports(stage):
    imports = true_imports(ROOT, stage.module)
    declared = {entry for entry in stage.dependencies if entry.startswith("pipeline/")}
    # A room of several commands is named file by file: a new word in the sampling must not train the model again.
    rooms = {path: "/".join(path.parts[:2]) for path in imports if len(path.parts) > 2 and path.parts[1] not in SPLIT}
    needed = {rooms.get(path, str(path)) for path in imports}
    assert sorted(declared) == sorted(needed)


@each_stage
def test_who_uses_the_hand_depends_on_the_description_of_the_chosen_one(stage):
    described = [entry for entry in stage.dependencies if entry.startswith("hands")]
    assert described == (["hands/allegro"] if "pipeline/hand" in stage.dependencies else [])


@each_stage
def test_parameters_are_the_stage_s_own_sections(stage):
    assert sorted(stage.parameters) == sorted(stage.sections())


def test_a_harder_setting_is_a_parameter_of_its_own_stage_alone():
    own = {stage.name for stage in STAGES for name in stage.parameters if name.startswith("harder.settings.")}
    assert own == {stage.name for stage in STAGES if stage.name.startswith("evaluate-harder@")} != set()
    assert {stage.name for stage in STAGES if {"harder", "harder.settings"} & set(stage.parameters)} == {
        "report",
        "track",
    }


@each_room
def test_rooms_of_stages_do_not_import_each_other(room):
    rooms = {path.parts[1] for path in true_imports(ROOT, f"pipeline.{room}.__main__") if len(path.parts) > 2}
    assert rooms <= SHARED | {room}


@each_room
def test_a_stage_reads_no_parameter_but_its_sections(room):
    """Everything goes through ``load_parameters(sections(...))``, but the number of workers, which changes nothing."""
    for source in files_of(room):
        text = source.read_text()
        assert (
            "params.yaml" not in re.sub(r'help=".*?"|""".*?"""', "", text, flags=re.DOTALL)
            or "yaml.safe_load" not in text
        )
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "load_parameters":
                argument = node.args[0]
                assert isinstance(argument, ast.Call) and getattr(argument.func, "id", "") == "sections", source
        uses = len(re.findall(r"read_parameters\(", text))
        assert uses == len(re.findall(r"read_parameters\(\)\.compute\b", text)), f"{source} reads more than compute"


@each_room
def test_heavy_packages_are_imported_inside_functions(room):
    """A misspelt parameter must cost a tenth of a second, so nothing slow may load before it is found."""
    main = ROOT / "pipeline" / room / "__main__.py"
    seen, waiting = set(), [f"pipeline.{room}.__main__"]
    while waiting:
        name = waiting.pop()
        path = ROOT.joinpath(*name.split(".")).with_suffix(".py")
        if name in seen or not path.is_file():
            continue
        seen.add(name)
        for node in tree_of(path).body:
            modules = []
            if isinstance(node, ast.Import):
                modules = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module:
                modules = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            for module in modules:
                assert module.split(".")[0] not in HEAVY, f"{main} loads {module} through {path} when it starts"
                if module.startswith("pipeline."):
                    waiting.append(module)


@each_stage
def test_inputs_are_outputs_of_other_stages(stage):
    outputs = {entry for other in STAGES for entry in other.outputs}
    for entry in stage.dependencies:
        if entry.startswith(("pipeline/", "hands/")) or entry == "data/raw" or entry in PUBLISHED:
            assert (ROOT / entry).exists()
        else:
            made = [out for out in outputs if out == entry or out.startswith(entry + "/")]
            assert made, f"{stage.name} reads {entry}, which no stage writes"


def test_every_room_with_a_command_is_a_stage():
    commands = {path.parent.name for path in (ROOT / "pipeline").glob("*/__main__.py")}
    assert commands == set(ROOMS)


def test_every_stage_says_what_it_does():
    content = yaml.safe_load((ROOT / "dvc.yaml").read_text())
    for name, stage in content["stages"].items():
        description = stage.get("do", stage).get("desc", "")
        assert 0 < len(description) <= 80, f"`dvc stage list` shows at most 80 letters: {name}"


def test_outputs_are_ignored_by_git_and_records_are_not():
    """DVC must find nothing to add to .gitignore: it takes such lines back when a later stage fails."""

    def ignored(path: str) -> bool:
        return subprocess.run(["git", "check-ignore", "-q", path], cwd=ROOT).returncode == 0

    names = ("dataset.md", "summary.json", "tracking.json", "durations.json", "survival.csv", "success.csv")
    kept = {f"reports/{name}" for name in names}
    for stage in STAGES:
        for output in stage.outputs:
            assert ignored(output) != (output in kept), output
    assert ignored("mlflow.db") and not any(ignored(path) for path in kept | PUBLISHED)


def test_dvc_ignores_what_imports_and_killed_stages_leave():
    patterns = (ROOT / ".dvcignore").read_text().split()
    assert {"__pycache__", "*.pyc", "*.tmp"} <= set(patterns)
