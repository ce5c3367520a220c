"""What the text of a module says to Python: its imports, and a digest that comments and docstrings do not change."""

from __future__ import annotations

import ast
import hashlib
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache, lru_cache

Imported = tuple[str, str]  # module, and a name from it: "" for `import module`, "*" for all

_MODULE = re.compile(r"pipeline(?:\.\w+)+")
# Fields of syntax trees that follow from others, or that no program sees.
_UNSEEN = {"ctx", "kind", "type_comment", "type_ignores"}
# Nodes that can name a module.
_NAMING = {ast.Import, ast.ImportFrom, ast.Constant, ast.Call}
# Attributes through which a program reads the descriptions of a pydantic model's fields.
_MODELS_OF_FIELDS = {"model_fields", "model_json_schema"}


@dataclass(frozen=True)
class Source:
    """What a module, or a part of it, says."""

    digest: str  # without the descriptions of pydantic fields
    described_digest: str  # with them
    imports: frozenset[Imported]  # at any level, but not those for types alone
    reads_descriptions: bool


@lru_cache(maxsize=4)
def parsed(text: str) -> ast.Module:
    """Return the syntax tree of a module, which nobody may change.

    Raises:
        SyntaxError: the text is not Python.
    """
    return ast.parse(text)


@cache
def source(text: str, package: str) -> Source:
    """Return what the text of a module of ``package`` says.

    Raises:
        SyntaxError: the text is not Python.
    """
    return source_of(ast.parse(text).body, package)


def source_of(statements: Iterable[ast.stmt], package: str) -> Source:
    """Return what the statements of a module of ``package`` say; it is the same in every version of Python, mostly."""
    reader = _Reader(package)
    reader.read_all(statements)
    said = "".join(reader.said).encode()
    return Source(
        hashlib.sha256(said).hexdigest(),
        hashlib.sha256(said + "".join(reader.descriptions).encode()).hexdigest(),
        frozenset(reader.imports),
        reader.reads_descriptions,
    )


def _for_types_alone(node: ast.stmt) -> bool:
    """Return whether this is ``if TYPE_CHECKING:``, the body of which never runs."""
    return isinstance(node, ast.If) and _last_name(node.test) == "TYPE_CHECKING"


def _that_run(items: Iterable[ast.AST]) -> Iterator[ast.AST]:
    """Yield the items of a list in a syntax tree, without statements that do nothing, such as docstrings."""
    for item in items:
        if isinstance(item, ast.If) and _for_types_alone(item):
            yield from _that_run(item.orelse)
        elif not isinstance(item, ast.Pass) and not (
            isinstance(item, ast.Expr) and isinstance(item.value, ast.Constant) and isinstance(item.value.value, str)
        ):
            yield item


def _last_name(node: ast.AST) -> str:
    return node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""


def _imported_by(node: ast.AST, package: str) -> Iterator[Imported]:
    """Yield what a node by itself names: in a statement of import, as a whole string, or to find a package's files."""
    if isinstance(node, ast.Import):
        yield from ((alias.name, "") for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        parts = package.split(".")
        base = ".".join(parts[: len(parts) - node.level + 1]) if node.level else ""
        module = ".".join(filter(None, [base, node.module]))
        yield from ((module, alias.name) for alias in node.names)
    elif isinstance(node, ast.Constant):
        if isinstance(node.value, str) and _MODULE.fullmatch(node.value):
            yield node.value, ""
    elif isinstance(node, ast.Call) and _last_name(node.func) == "find_spec":
        for argument in node.args:
            if isinstance(argument, ast.Constant) and isinstance(argument.value, str):
                yield argument.value, ""


class _Reader:
    """Writes syntax trees down and notes what they import."""

    def __init__(self, package: str) -> None:
        self.package = package
        self.said: list[str] = []
        self.descriptions: list[str] = []
        self.imports: set[Imported] = set()
        self.reads_descriptions = False

    def read_all(self, items: Iterable[object]) -> None:
        self.said.append("[")
        for item in _that_run(items):  # type: ignore[arg-type]  # also names, in `global`
            self.read(item)
            self.said.append(",")
        self.said.append("]")

    def read(self, item: object) -> None:
        if not isinstance(item, ast.AST):
            self.said.append(ascii(item))
            return
        kind = type(item)
        if kind in _NAMING:
            self.imports.update(_imported_by(item, self.package))
        self.said.append(kind.__name__ + "(")
        described = kind is ast.Call and _last_name(item.func) == "Field"  # type: ignore[attr-defined]
        if kind is ast.Attribute and item.attr in _MODELS_OF_FIELDS:  # type: ignore[attr-defined]
            self.reads_descriptions = True
        for name in item._fields:
            value = getattr(item, name, None)
            if value is None or name in _UNSEEN:
                continue
            if isinstance(value, list):
                if described and name == "keywords":
                    self.read_descriptions(value)
                    value = [keyword for keyword in value if keyword.arg != "description"]
                if value:
                    self.said.append(name + "=")
                    self.read_all(value)
            else:
                self.said.append(name + "=")
                self.read(value)
        self.said.append(")")

    def read_descriptions(self, keywords: list[ast.keyword]) -> None:
        said, self.said = self.said, self.descriptions
        self.read_all(keyword for keyword in keywords if keyword.arg == "description")
        self.said = said
