"""No silent robot: whoever works with a hand is told which, and what a hand is made of stands in its description."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from pipeline.hand.model import load_hand
from pipeline.provenance.closure import closure, stated_sections
from pipeline.records.hands import known_hands
from tests.pipeline.declared import Stage, declared_stages

ROOT = Path(__file__).resolve().parents[2]
CODE = {file: ast.parse(file.read_text()) for room in ("pipeline", "tools") for file in (ROOT / room).rglob("*.py")}


def defaults_of_hand(tree: ast.Module) -> Iterator[int]:
    """Lines of parameters and fields that are a hand (and not a hand's name) and have a default."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            own = node.args
            positional = [*own.posonlyargs, *own.args]
            given = positional[len(positional) - len(own.defaults) :]
            given += [one for one, value in zip(own.kwonlyargs, own.kw_defaults, strict=True) if value is not None]
            yield from (one.lineno for one in given if one.arg == "hand" and said(one.annotation) != "str")
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            yield from [node.lineno] * (said(node.target) == "hand" and "Hand" in said(node.annotation))


def said(node: ast.expr | None) -> str:
    return "" if node is None else ast.unparse(node)


def is_entry_point(tree: ast.Module) -> bool:
    return any(isinstance(node, ast.If) and said(node.test) == "__name__ == '__main__'" for node in tree.body)


def names_a_hand(tree: ast.Module) -> list[int]:
    """Lines that call ``load_hand``."""
    calls = (node for node in ast.walk(tree) if isinstance(node, ast.Call))
    return [call.lineno for call in calls if said(call.func).split(".")[-1] == "load_hand"]


def places(found: dict[Path, list]) -> list[str]:
    return [f"{file.relative_to(ROOT)}: {what}" for file, own in sorted(found.items()) for what in own]


def test_no_parameter_and_no_field_is_a_hand_by_default() -> None:
    assert places({file: list(defaults_of_hand(tree)) for file, tree in CODE.items()}) == []


def test_only_entry_points_choose_a_hand() -> None:
    assert places({file: names_a_hand(tree) for file, tree in CODE.items() if not is_entry_point(tree)}) == []


WITHOUT = [one for one in declared_stages(ROOT) if one.lines and not any("hands/" in each for each in one.dependencies)]


@pytest.mark.parametrize("stage", WITHOUT, ids=lambda stage: stage.name)
def test_a_stage_that_uses_no_hand_does_not_depend_on_what_a_hand_is(stage: Stage) -> None:
    modules = closure(ROOT, [stage.module], stated_sections(ROOT, stage.module)).modules
    assert [name for name in modules if name.startswith(("pipeline.hand", "pipeline.records.parameters.hand"))] == []


def test_only_descriptions_name_links_joints_and_fingers() -> None:
    """Words of English (index, one, two, three), the palm, which every hand may have, and base_link are left out.

    The latter is the usual root of a URDF and a key of cuRobo's format.

    So is what guesses the description of a hand from the names that its parts have.
    """
    hands = [load_hand(name) for name in known_hands()]
    names = {name for hand in hands for name in (*hand.link_names, *hand.joint_names, *hand.finger_joints)}
    names -= {"palm", "base_link", "index", "one", "two", "three"}
    found = {
        file: [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and node.value in names]
        for file, tree in CODE.items()
        if file.stem not in ("finger_tree", "hand_guesses")
    }
    assert places(found) == []
