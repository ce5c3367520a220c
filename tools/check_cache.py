"""Reads every file in DVC's cache and compares it with the hash that is its name; removes what is damaged.

DVC trusts its cache: a file in it that a disk, a copy or a program damaged is handed out as a result, and even put in
the place of a fresh one. Run this when data look wrong, or after a disk was full or failed. What is removed, here and
where `dvc.lock` says it was handed out, is computed again by `dvc repro`, or fetched by `dvc pull`.
"""

from __future__ import annotations

import argparse
import hashlib
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from pipeline.records.errors import UserError
from pipeline.records.texts import parse_json, parse_yaml
from pipeline.stages.running import command

LOCK_FILE = Path("dvc.lock")
BLOCK = 1 << 20  # bytes


def cache_folder() -> Path:
    """Return where the cache lies; `dvc cache dir` may have moved it.

    Raises:
        UserError: this is no DVC repository.
    """
    from dvc.exceptions import NotDvcRepoError
    from dvc.repo import Repo

    try:
        with Repo() as repository:
            return Path(repository.cache.local.path)
    except NotDvcRepoError as error:
        raise UserError("there is no DVC repository here; run in the repository's root.") from error


def _hash(path: Path) -> str:
    digest = hashlib.md5(usedforsecurity=False)
    with path.open("rb") as source:
        while block := source.read(BLOCK):
            digest.update(block)
    return digest.hexdigest()


def damaged(cache: Path) -> Iterator[Path]:
    """Yield the cached files whose content is not what their name says."""
    for path in sorted(cache.glob("??/*")):
        if path.is_file() and _hash(path) != (path.parent.name + path.name).removesuffix(".dir"):
            yield path


def handed_out(cache: Path, hashes: set[str]) -> list[Path]:
    """Return the outputs in `dvc.lock` that are, or hold, one of the hashes.

    Raises:
        UserError: `dvc.lock` is damaged.
    """
    if not LOCK_FILE.exists():
        return []
    try:
        stages: dict[str, Any] = parse_yaml(LOCK_FILE.read_text())["stages"]
        outputs = [(Path(item["path"]), item["md5"]) for stage in stages.values() for item in stage.get("outs", [])]
    except (OSError, yaml.YAMLError, LookupError, TypeError, AttributeError) as error:
        raise UserError(f"{LOCK_FILE} is damaged; `git checkout {LOCK_FILE}` and run again.") from error
    return [path for path, name in outputs if {name, *_members(cache, name)} & hashes]


def _members(cache: Path, name: str) -> list[str]:
    """Return the hashes of the files in a cached folder; none for a file, or where its list is missing."""
    if not name.endswith(".dir"):
        return []
    try:
        return [item["md5"] for item in parse_json((cache / name[:2] / name[2:]).read_text())]
    except (OSError, ValueError, LookupError, TypeError):
        return []


def check(cache: Path) -> list[Path]:
    """Remove the damaged files and where they were handed out; return all that was removed."""
    found = list(damaged(cache))
    spoilt = handed_out(cache, {path.parent.name + path.name for path in found})
    for path in found:
        path.chmod(0o644)
        path.unlink()
    for path in spoilt:
        shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
    return found + spoilt


@command("check_cache")
def main(arguments: list[str] | None = None) -> int:
    """Command line of this module; exit code 1: something was damaged."""
    argparse.ArgumentParser(prog="python -m tools.check_cache", description=__doc__).parse_args(arguments)
    removed = check(cache_folder())
    for path in removed:
        print(f"removed {path}: damaged, or made of what is damaged")
    print("`dvc repro` makes them again" if removed else "every file in DVC's cache is what its name says")
    return 1 if removed else 0


if __name__ == "__main__":
    sys.exit(main())
