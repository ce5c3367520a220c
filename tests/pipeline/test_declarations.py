"""`dvc.yaml` tells the truth: a forgotten input or parameter is a stale result that nobody notices."""

import ast
import re
import subprocess
from pathlib import Path

import pytest
import yaml

from pipeline.provenance.closure import closure
from tests.pipeline.declared import HEAVY, IN_GIT, declared_stages

ROOT = Path(__file__).resolve().parents[2]
STAGES = declared_stages(ROOT)
OF_ITEMS = [stage for stage in STAGES if any(output.startswith("data/items/") for output in stage.outputs)]
MODULES = {stage.module: stage.room for stage in STAGES}
ROOMS = sorted(set(MODULES.values()) - {"code"})
READ_EVERYTHING = {stage.room for stage in STAGES if stage.reads_everything}
PUBLISHED = {"reports/learned_objectives.csv", "reports/learned_ablation.csv"}  # by scripts of benchmarks/

each_stage = pytest.mark.parametrize("stage", STAGES, ids=lambda stage: stage.name)
each_room = pytest.mark.parametrize("room", ROOMS)


def files_of(room: str) -> list[Path]:
    return sorted((ROOT / "pipeline" / room).glob("*.py"))


@each_stage
def test_parameters_are_the_stage_s_own_sections(stage):
    if stage.room == "code":
        assert "params.yaml" in stage.dependencies  # it fingerprints all
        return
    assert len(stage.lines) == 1
    if not stage.reads_everything:
        assert set(stage.parameters) == set(stage.sections())


@each_stage
def test_who_uses_the_hand_depends_on_the_description_of_the_chosen_one(stage):
    # pipeline.records.parameters checks the whole of params.yaml against the hand, but no result depends on that.
    uses = any(name.startswith("pipeline.hand.") for name in closure(ROOT, [stage.module]).modules)
    described = [entry for entry in stage.dependencies if entry.startswith("hands")]
    assert described == ["hands/allegro"] * uses


@pytest.mark.parametrize("room", sorted({*ROOMS} - READ_EVERYTHING))
def test_a_stage_reads_no_parameter_but_its_sections(room):
    """Each function reads params.yaml once, and gets its own sections; pairs follow from sections, too."""
    chosen = {"chosen_sequences", "tried_sequences", "second_objects"}
    allowed = {"load_parameters", "load_with_workers", *chosen}
    for source in files_of(room):
        tree = ast.parse(source.read_text())
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module == "pipeline.records.parameters":
                assert {alias.name for alias in node.names} <= allowed, source
        for function in (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)):
            called = [node for node in ast.walk(function) if isinstance(node, ast.Call)]
            reads = [call for call in called if getattr(call.func, "id", "") in allowed - chosen]
            assert len(reads) <= 1, f"{source}: {function.name} reads params.yaml {len(reads)} times"
            for call in reads:
                argument = call.args[0]
                assert isinstance(argument, ast.Call) and ast.unparse(argument.func).split(".")[-1] == "sections", (
                    source
                )


@each_room
def test_who_asks_for_the_pairs_declares_what_they_depend_on(room):
    asks = any(re.search(r"(chosen|tried)_sequences\(", source.read_text()) for source in files_of(room))
    for stage in STAGES:
        if asks and stage.room == room and not stage.reads_everything and stage.name != "evaluate-conditions":
            assert "picks" in stage.parameters
            assert {"seed", "styles", "pairs"} <= set(stage.parameters) or "reconstructed" in stage.parameters


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
        for node in ast.parse(path.read_text()).body:
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
    outputs = {entry for other in STAGES if other != stage for entry in other.outputs}
    assert "code.yaml" in outputs or stage.room == "code"
    for entry in stage.dependencies:
        if entry.startswith("hands/") or entry in {"data/raw", *PUBLISHED} or stage.room == "code":
            assert (ROOT / entry).exists()
        else:
            made = [out for out in outputs if out == entry or out.startswith(entry + "/")]
            assert made, f"{stage.name} reads {entry}, which no stage writes"


def test_every_stage_of_items_keeps_their_fingerprints_beside_its_results():
    for stage in OF_ITEMS:
        results, items = stage.outputs
        assert items == f"data/items/{stage.name.replace('@', '-')}.json" and not results.startswith("data/items")
    assert {stage.room for stage in STAGES} - {stage.room for stage in OF_ITEMS} == {"code", "report", "track"}


def test_every_room_with_a_command_is_a_stage():
    commands = {path.parent.name for path in (ROOT / "pipeline").glob("*/__main__.py")}
    assert commands == {
        "code",
        "plan",
        "propose",
        "replay",
        "score",
        *ROOMS,
    }  # by hand, on what stages have made or others


def test_the_number_of_stages_does_not_depend_on_the_objects():
    content = yaml.safe_load((ROOT / "dvc.yaml").read_text())
    assert not [name for name, stage in content["stages"].items() if isinstance(stage.get("foreach"), str)]


def test_every_stage_says_what_it_does():
    content = yaml.safe_load((ROOT / "dvc.yaml").read_text())
    for name, stage in content["stages"].items():
        description = stage.get("do", stage).get("desc", "")
        assert 0 < len(description) <= 80, f"`dvc stage list` shows at most 80 letters: {name}"


def test_outputs_are_ignored_by_git_and_records_are_not():
    """DVC must find nothing to add to .gitignore: it takes such lines back when a later stage fails."""

    def ignored(path: str) -> bool:
        return subprocess.run(["git", "check-ignore", "-q", path], cwd=ROOT).returncode == 0

    for stage in STAGES:
        for output in stage.outputs:
            assert ignored(output) != (output in IN_GIT), output
    assert ignored("mlflow.db") and ignored("data/.unfinished")
    assert not any(ignored(path) for path in IN_GIT | PUBLISHED)


def test_dvc_ignores_what_imports_and_killed_stages_leave():
    patterns = (ROOT / ".dvcignore").read_text().split()
    assert {"__pycache__", "*.pyc", "*.tmp", "/data/.unfinished"} <= set(patterns)
