"""Every stage, alone with what it declares: the same bytes, whatever the rest of params.yaml says."""

from __future__ import annotations

import copy
import shutil
from pathlib import Path

import pytest

from pipeline.records.parameters import Parameters
from tests.pipeline.conftest import WorkingCopy
from tests.pipeline.declared import Stage, declared_stages

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
STAGES = {stage.name: stage for stage in declared_stages(ROOT) if stage.room not in ("code", "track")}
CODE = ("pipeline", "constraints.txt", "dvc.yaml", "code.yaml")  # by which a stage knows its own fingerprint


def perturbed(content: dict, declared: tuple[str, ...], workers: int) -> dict:
    """Return valid parameters in which everything that ``declared`` does not name has another value where possible."""

    def is_declared(path: str) -> bool:
        return any(path == name or path.startswith(name + ".") for name in declared)

    changed_content = copy.deepcopy(content)
    changed_content["compute"]["workers"] = workers
    if not is_declared("conditions"):
        changed_content["conditions"] |= {"pairs": [], "settings": {}}  # they would hold styles and physics in place

    def try_value(parent: dict, key: str, value) -> None:
        old, parent[key] = parent[key], value
        try:
            Parameters.model_validate(changed_content).check_conditions()
        except ValueError:
            parent[key] = old

    def visit(section: dict, path: str) -> None:
        for key, value in section.items():
            name = f"{path}.{key}" if path else key
            if is_declared(name) or name.startswith("compute"):
                continue
            if isinstance(value, dict):
                visit(value, name)
            elif isinstance(value, bool):
                try_value(section, key, not value)
            elif isinstance(value, int):
                try_value(section, key, value + 1)
            elif isinstance(value, float):
                try_value(section, key, value * 0.97)
            elif isinstance(value, list):
                try_value(section, key, [] if path == "styles" else value[::-1])
            elif name == "pairs":
                try_value(section, key, 1)

    visit(changed_content, "")
    return changed_content


@pytest.mark.parametrize("stage", STAGES.values(), ids=STAGES)
def test_a_stage_gives_the_same_bytes_from_its_declared_inputs_alone(finished, tmp_path, stage: Stage):
    """Only what `dvc.yaml` declares is there, and every other parameter is different."""
    alone = WorkingCopy(tmp_path)
    known = {output: other.outputs for other in STAGES.values() for output in other.outputs}
    # A stage that names the fingerprints of prepared objects reads the objects.
    inputs = {path for entry in stage.dependencies for path in (known[entry] if "/items/" in entry else [entry])}
    for entry in (*sorted(inputs), *CODE):
        source, target = finished / entry, alone / entry
        if target.exists():  # declared twice, or in a folder that is
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, target)
    # params.yaml is checked as a whole, the hand too: stages that do not declare it see another description of it.
    description = alone / "hands/allegro/hand.yaml"
    if not description.exists():
        description.parent.mkdir(parents=True)
        text = (finished / "hands/allegro/hand.yaml").read_text()
        description.write_text(text.replace("radius: 0.012", "radius: 0.02").replace("title: ", "title: Another "))
    declared = tuple(finished.parameters()) if stage.reads_everything else stage.parameters
    # One stage in two processes, for that it makes no difference; tests of the rooms do the same for others.
    workers = 2 if stage.name == "evaluate@learned" else 1
    alone.write_parameters(perturbed(finished.parameters(), declared, workers))
    for command in stage.command.splitlines():
        done = alone.command(*command.split())
        assert done.returncode == 0, done.stderr
    expected = {
        path: value
        for path, value in finished.fingerprints().items()
        if any(path == output or path.startswith(output + "/") for output in stage.outputs)
    }
    assert expected
    made = alone.fingerprints(*{path.split("/")[0] for path in expected})
    assert {path: made.get(path) for path in expected} == expected
