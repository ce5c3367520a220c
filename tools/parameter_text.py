"""The user's own objects in the text of `params.yaml`: entries added by a round trip that keeps comments and quotes."""

from __future__ import annotations

import io
import json
import re
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any

import yaml
from ruamel.yaml import YAML
from ruamel.yaml.error import CommentMark, YAMLError
from ruamel.yaml.representer import RoundTripRepresenter
from ruamel.yaml.tokens import CommentToken
from ruamel.yaml.util import load_yaml_guess_indent

from pipeline.records import paths
from pipeline.records.errors import UserError


class _Representer(RoundTripRepresenter):
    """Writes null as ``null``, where ruamel.yaml would leave the value out."""


_Representer.add_representer(
    type(None), lambda representer, _: representer.represent_scalar("tag:yaml.org,2002:null", "null")
)


def _loaded(text: str) -> tuple[YAML, Any]:
    """Return the content of ``text`` with its layout, and what writes it with the same indents."""
    editor = YAML()
    editor.Representer = _Representer
    editor.preserve_quotes = True
    editor.width = 10**6  # columns; no value is wrapped
    content, sequence, offset = load_yaml_guess_indent(text, yaml=editor)
    first = re.search(r"^( +)\S", text, re.MULTILINE)
    mapping = len(first[1]) if first else 2
    editor.indent(mapping, *((2, 0) if offset is None else (sequence, offset)))
    return editor, content


def _last_value(holder: Any, key: Any) -> tuple[Any, Any]:
    """Return the collection and the key in it of the last value that is written under ``holder[key]``."""
    value = holder[key]
    if not (value and isinstance(value, dict | list)):
        return holder, key
    return _last_value(value, next(reversed(value)) if isinstance(value, dict) else len(value) - 1)


def _change(holder: Any, key: Any, change: Callable[[], None]) -> None:
    """Change ``holder[key]``; comments on the lines below it stay there, above what follows."""
    last, at = _last_value(holder, key)
    token = next(filter(None, last.ca.items.get(at, ())), None)
    beside, _, below = token.value.partition("\n") if token else ("", "", "")
    if token and beside:
        token.value = f"{beside}\n"
    elif token:
        del last.ca.items[at]
    change()
    if below:
        last, at = _last_value(holder, key)
        token = CommentToken(f"\n{below}", CommentMark(0))
        last.ca.items[at] = [token, None] if isinstance(last, list) else [None, None, token, None]
    if len(holder[key]) == 1:
        holder[key].fa.set_block_style()  # it was {} or []


def _changed(text: str, name: str, entry: dict[str, Any], styles: list[str]) -> str:
    editor, content = _loaded(text)
    # PyYAML writes the values so that it reads them back: 1e-05, for one, is a text to it.
    mesh = _loaded(yaml.safe_dump(entry, sort_keys=False))[1]
    at = (content["meshes"], name) if name in content["meshes"] else (content, "meshes")
    _change(*at, lambda: content["meshes"].update({name: mesh}))
    for style in styles:
        if name not in content["styles"][style]:
            _change(content["styles"], style, partial(content["styles"][style].append, name))
    written = io.StringIO()
    editor.dump(content, written)
    return written.getvalue()


def _comments(text: str) -> Counter[str]:
    return Counter(comment.rstrip() for comment in re.findall(r"#.*", text))


def with_mesh(text: str, name: str, entry: dict[str, Any], styles: list[str]) -> str:
    """Return the text of ``params.yaml`` with the object ``name`` under ``meshes`` and in the lists of ``styles``.

    An entry of that name is replaced; styles that already list it still do. Comments, order, quotes and indents stay.

    Raises:
        UserError: the text is written in such a way that the entries cannot be added safely.
    """
    expected = json.loads(json.dumps(yaml.safe_load(text)))  # a copy in which no two names share a value
    replaced = expected["meshes"].get(name)
    expected["meshes"][name] = entry
    for style in styles:
        if name not in expected["styles"][style]:
            expected["styles"][style].append(name)
    try:
        changed = _changed(text, name, entry, styles)
        sound = yaml.safe_load(changed) == expected and (replaced or _comments(text) <= _comments(changed))
    except (yaml.YAMLError, YAMLError):
        sound = False
    if not sound:
        flow = yaml.safe_dump({name: entry}, default_flow_style=True, sort_keys=False, width=10**6).strip()[1:-1]
        by_hand = ", ".join([f"`{flow}` under meshes", *(f"{name} in styles.{style}" for style in styles)])
        raise UserError(f"{paths.PARAMETERS_FILE} cannot be extended in the way it is written; add {by_hand} yourself.")
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
