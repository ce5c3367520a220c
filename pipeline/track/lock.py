"""What ``dvc.yaml`` and ``dvc.lock`` say about the stages of a run: pure functions over their parsed content."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

COMPUTE = "compute"  # the section of params.yaml on which no result depends
HARDER = "evaluate-harder"  # of earlier results; its items were settings, not objects
# Stages that are no part of a result: fingerprints of the code, and the record itself.
OWN_STAGES = ("code", "track")
CODE_FOLDER, CODE_FILE = "pipeline/", "code.yaml"
ITEMS_FOLDER = "data/items/"  # which items a stage has made from what: no result, and other where only code has changed


@dataclass(frozen=True)
class LockedStage:
    """One stage as DVC last ran or restored it."""

    name: str  # such as synthesize-pinch@cube
    parameters: dict[str, Any]  # flat, as the stage declared them
    outputs: dict[str, str]  # path -> hash
    fingerprint: str  # of dependencies, parameters and results: equal for a stage that was reused
    inputs: dict[str, str] = field(default_factory=dict)  # path -> hash of what it read, code left out


def digest(content: Any) -> str:
    """Return a short hash of plain data, the same for the same content."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def flatten(content: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested mappings as one with dotted keys; lists become JSON text, values that are None are left out.

    MLflow refuses `+` in names, so that ``contacts.thumb+index`` becomes ``contacts.thumb-index``.
    """
    flat: dict[str, Any] = {}
    for key, value in content.items():
        name = f"{prefix}{key}".replace("+", "-")
        if isinstance(value, Mapping):
            flat |= flatten(value, f"{name}.")
        elif isinstance(value, list | tuple):
            flat[name] = json.dumps(value)
        elif value is not None:
            flat[name] = value
    return flat


def stage_names(declared: Mapping[str, Any], parameters: Mapping[str, Any]) -> list[str]:
    """Return the DVC names of all stages but ``OWN_STAGES`` in the order of ``dvc.yaml``.

    ``dvc.lock`` alone would not do: it also keeps stages that are gone.

    Args:
        declared: content of ``dvc.yaml``.
        parameters: content of ``params.yaml``, in which the items of a ``foreach`` stand.

    Raises:
        ValueError: the items of a stage cannot be found.
    """
    names = []
    for name, entry in (declared.get("stages") or {}).items():
        if "matrix" in entry:
            raise ValueError(f"stage {name} is a matrix, which the record does not know")
        items = _items(entry["foreach"], parameters) if "foreach" in entry else None
        names += [name] if items is None else [f"{name}@{item}" for item in items]
    return [name for name in names if name not in OWN_STAGES]


def _items(foreach: Any, parameters: Mapping[str, Any]) -> Iterable[Any]:
    content = foreach
    if isinstance(foreach, str):
        place = re.fullmatch(r"\$\{([\w.]+)\}", foreach.strip())
        content = parameters if place else None
        for key in place[1].split(".") if place else ():
            content = content.get(key) if isinstance(content, Mapping) else None
    if not isinstance(content, Mapping | list):
        raise ValueError(f"params.yaml does not hold what dvc.yaml lists as {foreach}")
    return content


def locked_stages(lock: Mapping[str, Any], names: Iterable[str]) -> list[LockedStage]:
    """Return the named stages that ``dvc.lock`` knows, in the order of ``names``."""
    known = lock.get("stages") or {}
    return [_locked(name, known[name]) for name in names if name in known]


def _hashes(items: Iterable[Mapping[str, Any]]) -> dict[str, str]:
    """Return the hashes of results by path; what only says how they were made is left out."""
    found = {str(item["path"]): str(item.get("md5") or item.get("hash")) for item in items}
    return {path: text for path, text in found.items() if path != CODE_FILE and not path.startswith(ITEMS_FOLDER)}


def _locked(name: str, entry: Mapping[str, Any]) -> LockedStage:
    parameters: dict[str, Any] = {}
    for file, content in (entry.get("params") or {}).items():
        if file != CODE_FILE:
            parameters |= flatten(content or {})
    outputs = _hashes(entry.get("outs") or [])
    dependencies = _hashes(entry.get("deps") or [])
    return LockedStage(
        name=name,
        inputs={path: text for path, text in dependencies.items() if not path.startswith(CODE_FOLDER)},
        parameters=parameters,
        outputs=outputs,
        fingerprint=digest([name, dependencies, parameters, outputs]),
    )
