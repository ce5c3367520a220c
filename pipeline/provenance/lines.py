"""The lines of ``code.yaml``: one fingerprint for each command of ``dvc.yaml``, and one for each section of settings.

A stage names its line and its sections among its parameters, so that DVC runs it again when, and only when, one of them
changed::

    params: [{code.yaml: [validate, settings.physics, settings.validate]}]

So ``dvc.lock`` holds a few digits for a section, not a thousand objects, and DVC reads ``params.yaml`` once, not once
for each stage.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Collection
from pathlib import Path
from typing import Any

import yaml

from pipeline.provenance.closure import closure, data_files, module_file, stated_sections
from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.texts import parse_yaml

SETTINGS = "settings"  # under which the sections of params.yaml stand
ALL = "all"  # the line among them that stands for all sections together
IRRELEVANT = "compute"  # the section that decides where and how fast something is computed, never what

_STAGES_FILE = Path("dvc.yaml")
_PINS_FILE = Path("constraints.txt")
_COMMAND = re.compile(r"\bpython -m (pipeline(?:\.\w+)+)")
_WRITER = "pipeline.code.__main__"  # its stage has no line, but depends on all files
_LENGTH = 10  # hexadecimal digits of a fingerprint: one change in 10^12 is missed, and dvc.lock stays small
# Packages that users install by themselves, in whatever version they have.
_OF_USERS = {"curobo"}
# Packages that are imported by another name than they are installed by.
_DISTRIBUTIONS = {
    "PIL": "pillow",
    "cv2": "opencv-python",
    "griffe": "griffelib",
    "mujoco": "mujoco-core",
    "pinocchio": "pin",
    "warp": "warp-lang",
    "yaml": "pyyaml",
}


def code_lines(root: Path) -> dict[str, Any]:
    """Return all lines of ``code.yaml``.

    Raises:
        UserError: ``dvc.yaml``, ``params.yaml`` or a module cannot be read, or says something that does not fit.
    """
    lines = {line: fingerprint(root, modules) for line, modules in declared_commands(root).items()}
    return dict(sorted({**lines, SETTINGS: settings_digests(root)}.items()))


def code_line(root: Path, line: str) -> str:
    """Return one line of ``code.yaml``.

    Raises:
        UserError: see :func:`code_lines`, or no stage names the line.
    """
    commands = declared_commands(root)
    if line not in commands:
        raise UserError(f"{_STAGES_FILE}: no stage names the line {line!r} of {paths.CODE_FILE}; add it to its params.")
    return fingerprint(root, commands[line])


def _mapping(file: Path) -> dict[str, Any]:
    try:
        content = parse_yaml(file.read_text(), getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except FileNotFoundError as error:
        raise UserError(f"{file} is missing; run in the repository's root, or `git checkout {file.name}`.") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise UserError(f"{file} is not valid YAML: {' '.join(str(error).split())}; correct it there.") from error
    if not isinstance(content, dict):
        raise UserError(f"{file} holds no names and values; `git checkout {file.name}` restores it.")
    return content


def settings_digests(root: Path) -> dict[str, Any]:
    """Return a fingerprint of every section of ``params.yaml`` on which results depend, by name, and one of all.

    Where a stage names a part of a section, such as ``settings.styles.pinch``, each part has its own.

    Raises:
        UserError: a file is missing or is not YAML.
    """
    stages = _mapping(root / _STAGES_FILE).get("stages")
    named = {
        tuple(line.split("."))
        for stage in (stages if isinstance(stages, dict) else {}).values()
        for line in _named_lines((stage.get("do", stage) if isinstance(stage, dict) else {}).get("params", []))
    }
    divided = {parts[1] for parts in named if parts[0] == SETTINGS and len(parts) > 2}
    sections = {name: each for name, each in _mapping(root / paths.PARAMETERS_FILE).items() if name != IRRELEVANT}
    return {ALL: _digest(sections)} | {
        name: {part: _digest(own) for part, own in value.items()} if name in divided else _digest(value)
        for name, value in sections.items()
    }


def _digest(value: Any) -> str:
    """Return a short fingerprint of plain data, in its order."""
    return hashlib.sha256(ascii(value).encode()).hexdigest()[:_LENGTH]


def declared_commands(root: Path) -> dict[str, tuple[str, ...]]:
    """Return the modules that the stages of ``dvc.yaml`` run, by the line of ``code.yaml`` that they name.

    Several stages may name one line, if they run the same modules.

    Raises:
        UserError: a stage runs code of this project and names no line, or more than one; or two stages name one line
            and run different modules; or a module does not exist.
    """
    found: dict[str, tuple[str, ...]] = {}
    stages = _mapping(root / _STAGES_FILE).get("stages")
    for name, stage in (stages if isinstance(stages, dict) else {}).items():
        body = stage.get("do", stage) if isinstance(stage, dict) else {}
        modules = _modules(root, name, body.get("cmd", ""))
        if not modules or _WRITER in modules:
            continue
        lines = {line for line in _named_lines(body.get("params", [])) if line.split(".")[0] != SETTINGS}
        if len(lines) != 1:
            raise UserError(
                f"{_STAGES_FILE}: the stage {name} names {len(lines) or 'no'} line{'s' * (len(lines) > 1)} of "
                f"{paths.CODE_FILE}; write one under its params, such as `- {paths.CODE_FILE}: [{name}]`."
            )
        line = lines.pop()
        if found.setdefault(line, modules) != modules:
            raise UserError(
                f"{_STAGES_FILE}: the stage {name} names the line {line!r} of {paths.CODE_FILE}, which is that of "
                f"{', '.join(found[line])}; give it a line of its own."
            )
    return found


def _modules(root: Path, stage: str, command: Any) -> tuple[str, ...]:
    commands = command if isinstance(command, list) else [command]
    named = [name for each in commands for name in _COMMAND.findall(str(each))]
    modules = []
    for name in dict.fromkeys(named):
        run = next((each for each in (f"{name}.__main__", name) if module_file(root, each)), None)
        if run is None:
            raise UserError(f"{_STAGES_FILE}: the stage {stage} runs {name}, which does not exist; correct its cmd.")
        modules.append(run)
    return tuple(modules)


def _named_lines(declared: Any) -> set[str]:
    """Return the lines of ``code.yaml`` that ``params:`` of a stage names."""
    files = [entry for entry in (declared if isinstance(declared, list) else []) if isinstance(entry, dict)]
    return {str(name) for entry in files for name in entry.get(str(paths.CODE_FILE)) or []}


def fingerprint(root: Path, modules: Collection[str]) -> str:
    """Return the fingerprint of all code that a command can run which runs ``modules``.

    It is made of the syntax trees of the modules in the import closure without what does nothing (comments, docstrings,
    descriptions of parameters unless some module reads them), of the data files beside them, and of the pinned versions
    of the packages that they import.

    Raises:
        UserError: a module is not valid Python, or imports a package that ``constraints.txt`` does not name.
    """
    reached = closure(root, modules, {section for module in modules for section in stated_sections(root, module)})
    described = any(module.reads_descriptions for module in reached.modules.values())
    digest = hashlib.sha256()
    for name, module in reached.modules.items():
        digest.update(f"{name} {module.described_digest if described else module.digest}\n".encode())
    for file in data_files(root, reached.modules):
        digest.update(f"{file.relative_to(root).as_posix()} {hashlib.sha256(file.read_bytes()).hexdigest()}\n".encode())
    for pin in pins(root, reached.packages):
        digest.update(f"{pin}\n".encode())
    return digest.hexdigest()[:_LENGTH]


def pins(root: Path, packages: Collection[str]) -> list[str]:
    """Return the lines of ``constraints.txt`` for packages, given by the names by which they are imported, sorted.

    Raises:
        UserError: there is none for a package, or no such file.
    """
    file = root / _PINS_FILE
    try:
        text = file.read_text()
    except FileNotFoundError as error:
        raise UserError(f"{file} is missing; `git checkout {_PINS_FILE}` restores it.") from error
    known = {}
    for line in text.splitlines():
        name, separator, _ = line.partition("==")
        if separator and not line.startswith("#"):
            known[_normal(name)] = line.strip()
    found = []
    for package in set(packages) - _OF_USERS:
        name = _normal(_DISTRIBUTIONS.get(package, package))
        if name not in known:
            raise UserError(
                f"{file} pins no version of {package}, which the code of a stage imports; add it there, or, if it is "
                "installed by another name, to the names in pipeline/provenance/lines.py."
            )
        found.append(known[name])
    return sorted(found)


def _normal(name: str) -> str:
    """Return the name of a package as registries compare it (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).strip().lower()
