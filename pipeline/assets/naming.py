"""Object names from the paths of mesh files, and the choice of some of many."""

from __future__ import annotations

import hashlib
import re
import unicodedata
from collections import Counter
from collections.abc import Sequence
from pathlib import PurePosixPath


def plain(text: str) -> str:
    """Return a text in lower-case letters, digits and underscores: ``my_mug_2`` from ``My Mug (2)``."""
    ascii_only = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode().lower()
    return re.sub(r"[^a-z0-9]+", "_", ascii_only).strip("_")


def object_names(source: str, paths: Sequence[str]) -> dict[str, str]:
    """Return the path of every object by its name, sorted by path.

    A name is the source's, and of the path what tells the files apart: the file's name where all are different,
    otherwise the folders as well that are not the same for all.
    """
    parts = {path: PurePosixPath(path).with_suffix("").parts for path in sorted(paths)}
    found = {path: plain(own[-1]) for path, own in parts.items()}
    if _repeated(found.values()):
        common = set.intersection(*(set(own) for own in parts.values()))
        found = {path: plain(" ".join(part for part in own if part not in common)) for path, own in parts.items()}
    if _repeated(found.values()):
        found = {path: plain(path) for path in parts}
    return {f"{source}_{name}": path for path, name in found.items()}


def _repeated(names: object) -> bool:
    return max(Counter(names).values(), default=0) > 1  # type: ignore[call-overload]


def some_of(names: Sequence[str], count: int | None) -> list[str]:
    """Return ``count`` of the names in their order, drawn by the digest of each: more of them include these."""
    if count is None or count >= len(names):
        return list(names)
    drawn = set(sorted(names, key=lambda name: hashlib.sha256(name.encode()).digest())[:count])
    return [name for name in names if name in drawn]
