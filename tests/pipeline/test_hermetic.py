"""Every stage, alone with what it declares: the same bytes, whatever the rest of params.yaml says."""

from __future__ import annotations

import copy
import shutil
import sys

import pytest

from pipeline.records.parameters import Parameters
from tests.pipeline.conftest import WorkingCopy
from tests.pipeline.declared import Stage, declared_stages

pytestmark = pytest.mark.slow


def perturbed(content: dict, declared: tuple[str, ...]) -> dict:
    """Return valid parameters in which everything that ``declared`` does not name has another value where possible."""

    def is_declared(path: str) -> bool:
        return any(path == name or path.startswith(name + ".") for name in declared)

    changed_content = copy.deepcopy(content)
    changed_content["compute"]["workers"] = 2
    if not any(name.startswith("harder") for name in declared):
        changed_content["harder"] |= {"pairs": [], "settings": {}}  # they would hold styles and physics in place

    def try_value(parent: dict, key: str, value) -> None:
        old, parent[key] = parent[key], value
        try:
            Parameters.model_validate(changed_content)
        except ValueError:
            parent[key] = old

    def visit(section: dict, path: str) -> None:
        for key, value in section.items():
            name = f"{path}.{key}" if path else key
            if is_declared(name) or name.startswith(("compute", "objects")) and name != "objects":
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

    visit(changed_content, "")
    return changed_content


def stage_names() -> list[str]:
    styles = {"pinch": "cube", "side": "slender_cylinder"}
    names = [f"prepare@{name}" for name in styles.values()]
    names += [f"{stage}-{style}@{name}" for stage in ("synthesize", "validate") for style, name in styles.items()]
    names += ["merge@cube", "train", "sample@cube", "evaluate-synthesized@cube", "evaluate-learned@cube"]
    names += ["evaluate-harder@placement", "capture@tiny", "reconstruct@tiny"]
    names += ["sample-reconstructed@cube", "evaluate-reconstructed@cube"]
    return [*names, "report"]


@pytest.mark.parametrize("name", stage_names())
def test_a_stage_gives_the_same_bytes_from_its_declared_inputs_alone(finished, tmp_path, name):
    """Only what `dvc.yaml` declares is there, every other parameter is different, and two workers share the work."""
    stage: Stage = next(stage for stage in declared_stages(finished.root) if stage.name == name)
    alone = WorkingCopy(tmp_path)
    for entry in stage.dependencies:
        source, target = finished / entry, alone / entry
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
    alone.write_parameters(perturbed(finished.parameters(), stage.parameters))
    done = alone.command(sys.executable, *stage.command.split()[1:])
    assert done.returncode == 0, done.stderr
    expected = {
        path: value
        for path, value in finished.fingerprints().items()
        if any(path == output or path.startswith(output + "/") for output in stage.outputs)
    }
    made = alone.fingerprints(*{str(path).split("/")[0] for path in expected})
    assert {path: made.get(path) for path in expected} == expected
