"""Entries added to the text of `params.yaml` without touching any other byte of it: comments and layout stay."""

from __future__ import annotations

import json
from typing import Any

import yaml

from pipeline.records import paths
from pipeline.records.errors import UserError


def _child(node: yaml.Node, key: str) -> yaml.Node:
    """Return the value node of ``key`` in a mapping node."""
    assert isinstance(node, yaml.MappingNode)
    return next(value for name, value in node.value if name.value == key)


def _end_of_content(node: yaml.Node) -> int:
    """Return the index behind the last leaf of ``node``; the end of a block collection would include comments."""
    if isinstance(node, yaml.ScalarNode) or node.flow_style or not node.value:
        return int(node.end_mark.index)
    last = node.value[-1]
    return _end_of_content(last[1] if isinstance(last, tuple) else last)


def _flow(value: Any) -> str:
    return yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=10**6).removesuffix("\n...\n").strip()


def _added(text: str, node: yaml.Node, parent_indent: int, block: list[str], flow: str) -> str:
    """Return ``text`` with an item added at the end of the collection ``node``.

    Args:
        parent_indent: column of the key that holds the collection.
        block: lines of the item, as written in a block collection, without indent.
        flow: the item as written between brackets.
    """
    if node.flow_style and node.value:
        last = node.value[-1]
        at = _end_of_content(last[1] if isinstance(last, tuple) else last)
        return f"{text[:at]}, {flow}{text[at:]}"
    if node.flow_style:  # {} or []
        lines = "".join(f"\n{' ' * (parent_indent + 2)}{line}" for line in block)
        return text[: node.start_mark.index].rstrip(" ") + lines + text[node.end_mark.index :]
    end = text.find("\n", _end_of_content(node))
    end = len(text) if end < 0 else end
    return text[:end] + "".join(f"\n{' ' * node.start_mark.column}{line}" for line in block) + text[end:]


def _with_item(text: str, path: list[str], block: list[str], flow: str) -> str:
    node: yaml.Node = yaml.compose(text, Loader=yaml.SafeLoader)
    for key in path:
        node = _child(node, key)
    return _added(text, node, 2 * (len(path) - 1), block, flow)


def _without_first(text: str, path: list[str], key: str) -> str:
    """Return ``text`` without the lines of the first entry ``key`` of the block mapping at ``path``."""
    node: yaml.Node = yaml.compose(text, Loader=yaml.SafeLoader)
    for part in path:
        node = _child(node, part)
    name, value = next(pair for pair in node.value if pair[0].value == key)
    begin = text.rfind("\n", 0, name.start_mark.index) + 1
    end = text.find("\n", _end_of_content(value))
    return text[:begin] + (text[end + 1 :] if end >= 0 else "")


def with_mesh(text: str, name: str, entry: dict[str, Any], styles: list[str]) -> str:
    """Return the text of ``params.yaml`` with the object ``name`` under ``meshes`` and in the lists of ``styles``.

    An entry of that name is replaced; styles that already list it still do.

    Raises:
        UserError: the text is written in a way to which no line can be added safely.
    """
    before = yaml.safe_load(text)
    expected = json.loads(json.dumps(before))  # a copy in which no two names share a value
    expected["meshes"][name] = entry
    lines = [f"{name}:", *(f"  {key}: {_flow(value)}" for key, value in entry.items())]
    changed = None
    try:
        changed = _with_item(text, ["meshes"], lines, f"{name}: {_flow(entry)}")
        if name in before["meshes"]:
            changed = _without_first(changed, ["meshes"], name)
        for style in styles:
            if name not in before["styles"][style]:
                expected["styles"][style].append(name)
                changed = _with_item(changed, ["styles", style], [f"- {name}"], name)
        sound = yaml.safe_load(changed) == expected
    except yaml.YAMLError:
        sound = False
    if changed is None or not sound:
        by_hand = ", ".join([f"`{name}: {_flow(entry)}` under meshes", *(f"{name} in styles.{s}" for s in styles)])
        raise UserError(f"{paths.PARAMETERS_FILE} is written in a way that cannot be added to; write {by_hand} there.")
    return changed


def own_meshes(content: dict[str, Any]) -> dict[str, tuple[dict[str, Any], list[str]]]:
    """Return name -> (entry, styles) of the objects under ``meshes`` of the parameters ``content``."""
    return {
        name: (entry, [style for style, names in content["styles"].items() if name in names])
        for name, entry in content["meshes"].items()
    }


def without_meshes(content: dict[str, Any]) -> dict[str, Any]:
    """Return parameters without the objects under ``meshes``."""
    own = content["meshes"]
    styles = {style: [name for name in names if name not in own] for style, names in content["styles"].items()}
    return content | {"meshes": {}, "styles": styles}
