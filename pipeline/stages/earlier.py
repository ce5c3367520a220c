"""What a stage made before, read from DVC's cache.

DVC removes a stage's outputs before it runs its command. They are still in the cache, under the hashes that
``dvc.lock`` or DVC's record of earlier runs names: a directory is a JSON list of relative paths and md5 sums, a file
lies under ``files/md5/<first two digits>/<the others>``
(https://dvc.org/doc/user-guide/project-structure/internal-files). Nothing is written there, and no file is used whose
content is not what its name says.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import yaml

LOCK_FILE = Path("dvc.lock")
MOST_RUNS = 50  # earlier runs of a stage that are looked at, the latest first


class EarlierRun:
    """Outputs of one earlier run of a stage: its folder of results and the fingerprints of the items in it."""

    def __init__(self, cache: Path, folder_md5: str, index_md5: str) -> None:
        self._cache, self._folder_md5, self._index_md5 = cache, folder_md5, index_md5
        self._sound: dict[str, Path | None] = {}

    @cached_property
    def fingerprints(self) -> dict[str, str]:
        """Fingerprint of every item of the run, by key; empty where the cache has lost it."""
        path = self._object(self._index_md5)
        return json.loads(path.read_bytes()) if path else {}

    @cached_property
    def files(self) -> dict[str, str]:
        """Hash of every file in the folder of results, by its path there."""
        path = self._object(self._folder_md5)
        return {entry["relpath"]: entry["md5"] for entry in json.loads(path.read_bytes())} if path else {}

    def file(self, name: str) -> Path | None:
        """Return where the cache holds a file of the folder; None if it is gone or damaged."""
        return self._object(self.files[name]) if name in self.files else None

    def _object(self, md5: str) -> Path | None:
        if md5 not in self._sound:
            path = self._cache / md5[:2] / md5[2:]
            try:
                sound = hashlib.md5(path.read_bytes(), usedforsecurity=False).hexdigest() == md5.removesuffix(".dir")
            except OSError:
                sound = False
            self._sound[md5] = path if sound else None
        return self._sound[md5]


def earlier_runs(stage: str, folder: Path, index: Path) -> Iterator[EarlierRun]:
    """Yield earlier runs of a stage: the one that ``dvc.lock`` names, then others that DVC remembers, latest first.

    Args:
        stage: its name in ``dvc.lock``.
        folder: output with the results.
        index: output with the fingerprints of the items.
    """
    cache = cache_folder()
    if cache is None:
        return
    seen: set[tuple[str, str]] = set()
    for outputs in _recorded_outputs(stage, index, cache):
        hashes = (outputs.get(folder.as_posix(), ""), outputs.get(index.as_posix(), ""))
        if all(hashes) and hashes not in seen:
            seen.add(hashes)
            yield EarlierRun(cache / "files/md5", *hashes)


def cache_folder() -> Path | None:
    """Return DVC's cache as this repository, the user and the machine configure it; None outside of a repository."""
    from dvc.config import Config, ConfigError
    from dvc.exceptions import NotDvcRepoError

    try:
        config = Config.from_cwd()
    except (ConfigError, NotDvcRepoError):
        return None
    if config.dvc_dir is None:
        return None
    return Path(config.get("cache", {}).get("dir") or Path(config.dvc_dir) / "cache")


def locked_outputs(stage: str) -> dict[str, str]:
    """Return the md5 of every output of a stage in ``dvc.lock``, by path; empty where there is none."""
    try:
        lock = _parse(LOCK_FILE.read_text())
    except OSError:
        return {}
    stages = lock.get("stages") if isinstance(lock, dict) else None
    return _outputs(stages.get(stage)) if isinstance(stages, dict) else {}


def _recorded_outputs(stage: str, index: Path, cache: Path) -> Iterator[dict[str, str]]:
    yield locked_outputs(stage)
    mention = f"path: {index.as_posix()}\n"
    records = [(path.stat().st_mtime_ns, path) for path in (cache / "runs").glob("*/*/*") if path.is_file()]
    found = 0
    for _, path in sorted(records, reverse=True):
        try:
            text = path.read_text()
        except OSError:
            continue
        if mention in text and found < MOST_RUNS:
            found += 1
            yield _outputs(_parse(text))


def _outputs(entry: Any) -> dict[str, str]:
    outs = entry.get("outs", []) if isinstance(entry, dict) else []
    return {
        str(out["path"]): str(out["md5"]) for out in outs if isinstance(out, dict) and {"path", "md5"} <= out.keys()
    }


def _parse(text: str) -> Any:

    try:
        return yaml.load(text, yaml.CSafeLoader)
    except yaml.YAMLError:
        return None
