"""What a fingerprint of imports would not see: modules that are loaded by other means, and docstrings that are read."""

from __future__ import annotations

import ast
from collections.abc import Iterator

# Modules that load others; of `importlib` only what finds packages and their files is harmless.
_LOADERS = {"builtins", "imp", "importlib", "pkgutil", "runpy", "zipimport"}
_HARMLESS_MODULES = {"importlib.metadata", "importlib.resources"}
_HARMLESS_NAMES = {"importlib.util.find_spec"}
_BUILTINS = {"__import__", "compile", "eval", "exec"}
_FUNCTIONS = {"import_module"}  # where another name of `importlib` brought it along


def unseen(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Yield the line and the name of everything in a module that the fingerprints of code cannot follow."""
    described = (node for node in ast.walk(tree) if isinstance(node, ast.keyword) and node.arg == "description")
    help_texts = {id(part) for keyword in described for part in ast.walk(keyword)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names if _is_loader(alias.name))
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            yield from ((node.lineno, name) for name in names if _is_loader(name))
        elif isinstance(node, ast.Name | ast.Attribute):
            name, refused = (node.id, _BUILTINS) if isinstance(node, ast.Name) else (node.attr, _FUNCTIONS)
            if name in refused or (name == "__doc__" and id(node) not in help_texts):
                yield node.lineno, name


def _is_loader(name: str) -> bool:
    harmless = name in _HARMLESS_NAMES or any(f"{name}.".startswith(f"{module}.") for module in _HARMLESS_MODULES)
    return name.split(".")[0] in _LOADERS and not harmless
