"""All modules that a command can run: those that its own imports, at any level, theirs, and so on."""

from __future__ import annotations

import ast
import sys
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

from pipeline.provenance import selection
from pipeline.provenance.syntax import Source, parsed, source, source_of
from pipeline.records.errors import UserError

ROOT_PACKAGE = "pipeline"
# It compares fingerprints: a stage goes on or stops, but no result depends on it.
NOT_FOLLOWED = "pipeline.stages.code"
_NO_DATA = {".py", ".pyc", ".tmp"}


@dataclass(frozen=True)
class Closure:
    """What a command runs."""

    modules: dict[str, Source]  # of this project, by name, sorted
    packages: frozenset[str]  # names by which packages of others are imported, such as `yaml`


def module_file(root: Path, module: str) -> Path | None:
    """Return the file of a module or package below ``root``; None: there is none."""
    path = root.joinpath(*module.split("."))
    for file in (path / "__init__.py", path.with_suffix(".py")):
        if file.is_file():
            return file
    return None


def closure(root: Path, modules: Collection[str], sections: Collection[str] | None = None) -> Closure:
    """Return the import closure of ``modules``.

    Args:
        root: the repository.
        modules: their names, such as ``pipeline.merge.__main__``.
        sections: which sections of ``params.yaml`` are read, see :mod:`pipeline.provenance.selection`; None: all, and
            their checks count as well.

    Raises:
        UserError: a module is not valid Python.
    """
    found: dict[str, Source] = {}
    packages: set[str] = set()
    used: set[str] = set() if sections is not None else {"*"}  # names of the parameters' module
    waiting = [parent for module in modules for parent in _with_parents(module)]
    while waiting:
        name = waiting.pop()
        file = module_file(root, name)
        if name in found or name == NOT_FOLLOWED or file is None:
            continue
        found[name] = _source(file, name, used, sections)
        for module, imported in found[name].imports:
            if module.split(".")[0] != ROOT_PACKAGE:
                packages.add(module.split(".")[0])
                continue
            within = f"{module}.{imported}"
            is_module = bool(imported) and module_file(root, within) is not None
            waiting += _with_parents(within if is_module else module)
            needed = _needed_parameters(module, imported, is_module)
            if needed and needed not in used:
                used.add(needed)
                found.pop(selection.MODULE, None)
                waiting.append(selection.MODULE)
    return Closure(dict(sorted(found.items())), frozenset(packages - sys.stdlib_module_names))


def stated_sections(root: Path, module: str) -> frozenset[str]:
    """Return the first parts of the names of all sections of ``params.yaml`` that a command may read.

    They are the texts in its function ``sections``, wherever that is defined; a command without one may read all.

    Raises:
        UserError: a module is not valid Python.
    """
    file = module_file(root, module)
    tree = _parsed(file) if file else ast.Module([], [])
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and node.name == "sections":
            return frozenset(selection.first_parts(node)) or selection.ALL
        if isinstance(node, ast.ImportFrom) and "sections" in {alias.asname or alias.name for alias in node.names}:
            return stated_sections(root, node.module or "")
    return selection.ALL


def _with_parents(module: str) -> list[str]:
    """Return the modules that are run to import one: of ``a.b.c`` also ``a`` and ``a.b``."""
    parts = module.split(".")
    return [".".join(parts[:length]) for length in range(1, len(parts) + 1)]


def _needed_parameters(module: str, imported: str, is_module: bool) -> str:
    """Return which name of the parameters' module an import asks for: ``*``: all of them, '': none."""
    if module == selection.MODULE:
        return "" if is_module else imported or "*"
    whole = is_module and f"{module}.{imported}" == selection.MODULE
    within = not imported and module.startswith(f"{selection.MODULE}.")
    return "*" if whole or within else ""


def _source(file: Path, name: str, used: Collection[str], sections: Collection[str] | None) -> Source:
    package = name if file.name == "__init__.py" else name.rpartition(".")[0]
    if name == selection.MODULE and sections is not None:
        return source_of(selection.used_statements(_parsed(file), used, sections), package)
    try:
        return source(file.read_text(encoding="utf-8"), package)
    except (SyntaxError, ValueError) as error:
        raise _no_python(file, error) from error


def _parsed(file: Path) -> ast.Module:
    try:
        return parsed(file.read_text(encoding="utf-8"))
    except (SyntaxError, ValueError) as error:
        raise _no_python(file, error) from error


def _no_python(file: Path, error: Exception) -> UserError:
    line = getattr(error, "lineno", None)
    return UserError(f"{file}{f', line {line}' if line else ''}: this is not valid Python; correct it.")


def data_files(root: Path, modules: Collection[str]) -> list[Path]:
    """Return the files beside ``modules`` that are not code: all that git would take of their packages, sorted."""
    folders = {file.parent for module in modules if (file := module_file(root, module))}
    return sorted({file for folder in folders for file in _data_within(folder)})


def _data_within(folder: Path) -> Iterator[Path]:
    for entry in folder.iterdir():
        if entry.name.startswith(".") or entry.name == "__pycache__":
            continue
        if entry.is_dir():
            if not (entry / "__init__.py").is_file():  # otherwise it is a package of its own
                yield from _data_within(entry)
        elif entry.suffix not in _NO_DATA:
            yield entry
