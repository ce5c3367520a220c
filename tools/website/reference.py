"""Pages of the reference: the code's rooms and modules, the parameters, and the commands of ``./dev``."""

from __future__ import annotations

import ast
import json
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import yaml
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from tools.typed_defaults import MISSING, plain_default

# The search ranks these pages below those that were written to be read.
_HEADER = "---\ntitle: {title}\nsearch:\n  boost: 0.3\n---\n\n"


def rooms(root: Path) -> dict[str, list[str]]:
    """Return the public modules of every room by the room's name; the room itself comes first."""
    found = {}
    for package in sorted((root / "pipeline").glob("*/__init__.py")):
        files = sorted(package.parent.rglob("*.py"), key=lambda file: (file.name != "__init__.py", file))
        names = [".".join(file.relative_to(root).with_suffix("").parts) for file in files]
        public = [name.removesuffix(".__init__") for name in names if not re.search(r"\._(?!_init__)", name)]
        found[f"pipeline.{package.parent.name}"] = sorted(public, key=lambda name: (name.count("."), name))
    return found


def summary(room: str, root: Path) -> str:
    """Return the first sentence of a room's docstring."""
    text = ast.get_docstring(ast.parse(root.joinpath(*room.split("."), "__init__.py").read_text()))
    return " ".join((text or "").split("\n\n")[0].split())


def index(root: Path) -> str:
    """Return the page that lists all pages of the reference."""
    lines = [f"| [`{room}`]({room}.md) | {summary(room, root)} |" for room in rooms(root)]
    return (
        "# Reference\n\n"
        "- [Commands](commands.md): what `./dev` does.\n"
        "- [Parameters](parameters.md): every field of `params.yaml`, its range and where its value comes from.\n"
        "- [What the figures mean](../metrics.md): every key of `reports/summary.json`.\n\n"
        "## Code\n\n"
        "One page per folder of `pipeline/`, made of its docstrings. Lengths are metres, angles radians, z is up; "
        "`T_a_b` maps coordinates in b to a; quaternions are (w, x, y, z); joints are in the order `joint_0.0` to "
        "`joint_15.0`. Shapes stand in brackets, with B for a batch.\n\n"
        "| room | what it does |\n|---|---|\n" + "\n".join(lines) + "\n"
    )


def room_page(room: str, modules: list[str]) -> str:
    """Return the page of a room: its modules, which mkdocstrings fills in."""
    of_the_room = "    options:\n      heading_level: 1\n"
    parts = [f"::: {module}\n" + (of_the_room if module == room else "") for module in modules]
    return _HEADER.format(title=room) + "\n".join(parts)


def commands(root: Path) -> str:
    """Return the page of all commands: what ``./dev COMMAND --help`` prints."""

    def printed(*arguments: str) -> str:
        done = subprocess.run([root / "dev", *arguments, "--help"], capture_output=True, text=True, check=True)
        return f"~~~~text\n{done.stdout.rstrip()}\n~~~~\n"

    usage = printed()
    names = re.findall(r"^  ([a-z-]+) +\S", usage, re.MULTILINE)
    return f"# Commands\n\n{usage}\n" + "\n".join(f"## ./dev {name}\n\n{printed(name)}" for name in names)


def _kind(annotation: Any) -> str:
    """Return a type in words: ``integer``, ``cpu, cuda``, ``list of number``."""
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _kind(inner[0])
    if origin is Literal:
        return " or ".join(f"`{value}`" for value in inner)
    if origin in (Union, UnionType):
        return " or ".join(_kind(choice) for choice in inner)
    if origin in (list, tuple):
        kinds = list(dict.fromkeys(_kind(item) for item in inner if item is not Ellipsis))
        return f"list of {' and '.join(kinds)}"
    if origin is dict:
        return f"{_kind(inner[1])} by name"
    names = {int: "integer", float: "number", bool: "true or false", str: "text", NoneType: "null"}
    return names.get(annotation) or f"see `{annotation.__name__}`"


def _range(field: FieldInfo) -> str:
    signs = {"ge": "≥", "gt": ">", "le": "≤", "lt": "<"}
    return ", ".join(
        f"{signs[name]} {getattr(bound, name):g}" for bound in field.metadata for name in signs if hasattr(bound, name)
    )


def _models(annotation: Any) -> list[tuple[str, type[BaseModel]]]:
    """Return the sections inside a type, with what stands between its name and theirs."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [("", annotation)]
    between = {dict: ".<name>", list: "[]", tuple: "[]"}.get(get_origin(annotation), "")
    return [(between + path, model) for part in get_args(annotation) for path, model in _models(part)]


def _sections(model: type[BaseModel], path: str, shared: Any) -> Iterator[tuple[str, str, list[str]]]:
    """Yield every section: its dotted name, what it is, and the rows of its table.

    Args:
        shared: what ``conf/config.yaml`` gives in this section, for fields that have no default.
    """
    rows, below = [], []
    for name, field in model.model_fields.items():
        name = field.alias or name
        inner = _models(field.annotation)
        own = (shared or {}).get(name)
        below += [(f"{path}.{name}{between}".lstrip("."), section, own) for between, section in inner]
        if not inner or field.description:
            limits = _range(field)
            value = plain_default(field) if not field.is_required() or name not in (shared or {}) else own
            default = "" if value == MISSING else f"`{json.dumps(value)}`"
            kind = "below" if inner else _kind(field.annotation) + (f", {limits}" if limits else "")
            rows.append(f"| `{name}` | {kind} | {default} | {field.description or ''} |".replace("||", "| |"))
    yield path, " ".join((model.__doc__ or "").split()), rows
    for name, section, own in below:
        yield from _sections(section, name, own)


def parameters(model: type[BaseModel], root: Path) -> str:
    """Return the page of all parameters of a model such as ``records.parameters.Parameters``."""
    shared = yaml.safe_load((root / "conf" / "config.yaml").read_text())
    lines = [
        "# Parameters\n",
        "Every field of `params.yaml`, from the types in `pipeline/records/parameters/` that check it. `./dev compose` "
        "writes the value shown, unless a scale, hand or preset of `conf/` gives another.\n",
    ]
    for path, meaning, rows in _sections(model, "", shared):
        lines += [f"## {path.replace('<', '&lt;') or 'params.yaml'}\n", meaning + "\n"]
        if rows:
            lines += ["| field | type | value | meaning |", "|---|---|---|---|", *rows, ""]
    return "\n".join(lines) + "\n"
