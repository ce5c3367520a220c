"""The part of the parameters' module that a command uses.

``pipeline.records.parameters`` names every section of ``params.yaml`` and checks all of them for every command. What a
command gets depends on its own sections alone: the others, and the checks, can only stop it.
"""

from __future__ import annotations

import ast
from collections.abc import Collection, Iterator

MODULE = "pipeline.records.parameters"
CLASS = "Parameters"  # which has a field for every section
ALL = frozenset({"*"})  # sections, where a command does not state its own


def used_statements(tree: ast.Module, names: Collection[str], sections: Collection[str]) -> list[ast.stmt]:
    """Return the statements of the module on which ``names`` depend, when only ``sections`` are read.

    Args:
        names: what other modules import from it; ``*``: everything.
        sections: first parts of their names, such as ``synthesize``; or :data:`ALL`.
    """
    body = [
        _with_sections(statement, sections)
        if isinstance(statement, ast.ClassDef) and statement.name == CLASS
        else statement
        for statement in tree.body
    ]
    if "*" in names:
        names = {name for statement in body for name in _defined(statement) or ()}
    used: set[str] = set()
    waiting = set(names).union(*(_named(statement) for statement in body if _defined(statement) is None))
    while waiting:
        used |= waiting
        waiting = set().union(*(_named(each) for each in body if used & set(_defined(each) or ()))) - used
    return [part for statement in body for part in _part(statement, used)]


def first_parts(function: ast.FunctionDef) -> set[str]:
    """Return the first parts of all dotted names among the texts of a function's code."""
    body = function.body[ast.get_docstring(function) is not None :]
    constants = [node.value for each in body for node in ast.walk(each) if isinstance(node, ast.Constant)]
    return {text.split(".")[0] for text in constants if isinstance(text, str)}


def _with_sections(parameters: ast.ClassDef, sections: Collection[str]) -> ast.ClassDef:
    """Return the class with the fields of ``sections``, the methods that read no others, and no validators."""
    fields = {each.target.id: each for each in parameters.body if _is_field(each)}  # type: ignore[attr-defined]
    own = {name for name, field in fields.items() if {"*", name, _alias(field)} & set(sections)}
    kept: list[ast.stmt] = []
    for statement in parameters.body:
        if _is_field(statement):
            keep = statement.target.id in own  # type: ignore[attr-defined]
        elif isinstance(statement, ast.FunctionDef):
            read = {node.attr for node in ast.walk(statement) if _is_of_self(node)}  # type: ignore[attr-defined]
            keep = not _is_validator(statement) and read & fields.keys() <= own
        else:
            keep = True
        if keep:
            kept.append(statement)
    return ast.ClassDef(**{**dict(ast.iter_fields(parameters)), "body": kept})


def _is_field(node: ast.stmt) -> bool:
    return isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)


def _is_of_self(node: ast.AST) -> bool:
    return isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "self"


def _is_validator(function: ast.FunctionDef) -> bool:
    named = {name for decorator in function.decorator_list for name in _named(decorator)}
    return bool(named & {"model_validator", "field_validator"})


def _alias(field: ast.stmt) -> str | None:
    """Return the name in ``params.yaml`` of a field that has another one in Python."""
    for node in ast.walk(field):
        if isinstance(node, ast.keyword) and node.arg == "alias" and isinstance(node.value, ast.Constant):
            return str(node.value.value)
    return None


def _defined(statement: ast.stmt) -> list[str] | None:
    """Return the names that a statement defines; None when it does something else as well."""
    if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return [statement.name]
    if isinstance(statement, ast.Import | ast.ImportFrom):
        return [alias.asname or alias.name.split(".")[0] for alias in statement.names]
    if isinstance(statement, ast.Assign | ast.AnnAssign):
        targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
        if all(isinstance(target, ast.Name) for target in targets):
            return [target.id for target in targets if isinstance(target, ast.Name)]
    return None


def _named(node: ast.AST) -> set[str]:
    return {each.id for each in ast.walk(node) if isinstance(each, ast.Name)}


def _part(statement: ast.stmt, used: Collection[str]) -> Iterator[ast.stmt]:
    """Yield the statement if it is used; of an import, the names that are."""
    names = _defined(statement)
    if isinstance(statement, ast.Import | ast.ImportFrom) and names is not None:
        kept = [alias for alias, name in zip(statement.names, names, strict=True) if name in used]
        if kept:
            yield type(statement)(**{**dict(ast.iter_fields(statement)), "names": kept})
    elif names is None or set(names) & set(used):
        yield statement
