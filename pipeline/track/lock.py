"""What ``dvc.lock`` says about the stages of this run: pure functions over its parsed content."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

HARDER = "evaluate-harder"  # its items are settings, not objects


@dataclass(frozen=True)
class LockedStage:
    """One stage as DVC last ran or restored it."""

    name: str  # such as synthesize-pinch@cube
    parameters: dict[str, Any]  # flat, as the stage declared them
    outputs: dict[str, str]  # path -> hash
    fingerprint: str  # of dependencies, parameters and outputs: equal for a stage that was reused


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


def stage_names(
    styles: Mapping[str, Iterable[str]],
    objects: Iterable[str],
    meshes: Iterable[str],
    sources: Iterable[str],
    renderings: Iterable[str] = (),
    captures: Iterable[str] = (),
    reconstructed: Iterable[str] = (),
    harder: Iterable[str] = (),
) -> list[str]:
    """Return the DVC names of all stages before ``track`` in order; ``dvc.lock`` also keeps stages that are gone."""
    names = [f"prepare@{name}" for name in objects] + [f"prepare-mesh@{name}" for name in meshes]
    for stage in ("synthesize", "validate"):
        names += [f"{stage}-{style}@{name}" for style, members in styles.items() for name in members]
    names += [f"merge@{first}" for first in styles["pinch"]]
    names += ["train", *(f"sample@{first}" for first in styles["pinch"])]
    names += [f"evaluate-{source}@{first}" for source in sources for first in styles["pinch"]]
    names += [f"capture@{name}" for name in renderings] + [f"reconstruct@{name}" for name in captures]
    names += [f"{stage}-reconstructed@{first}" for stage in ("sample", "evaluate") for first in reconstructed]
    names += [f"{HARDER}@{setting}" for setting in harder]
    return [*names, "report"]


def locked_stages(lock: Mapping[str, Any], names: Iterable[str]) -> list[LockedStage]:
    """Return the named stages that ``dvc.lock`` knows, in the order of ``names``."""
    known = lock.get("stages") or {}
    return [_locked(name, known[name]) for name in names if name in known]


def _hashes(items: Iterable[Mapping[str, Any]]) -> dict[str, str]:
    return {str(item["path"]): str(item.get("md5") or item.get("hash")) for item in items}


def _locked(name: str, entry: Mapping[str, Any]) -> LockedStage:
    parameters: dict[str, Any] = {}
    for content in (entry.get("params") or {}).values():
        parameters |= flatten(content or {})
    outputs = _hashes(entry.get("outs") or [])
    dependencies = _hashes(entry.get("deps") or [])
    return LockedStage(
        name=name,
        parameters=parameters,
        outputs=outputs,
        fingerprint=digest([name, dependencies, parameters, outputs]),
    )
