"""Compare every file in DVC's cache with the hash in its name, and remove the damaged ones.

DVC trusts its cache: a file in it that was damaged by a disk, a copy or a program is checked out as a result, and even
replaces a fresh one. Run this when data look wrong, or after a disk was full or failed. What is removed, from the cache
and from the outputs in `dvc.lock` that were checked out from it, is recomputed by `dvc repro` or fetched by `dvc pull`.
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
    """Return the folder of the cache, which `dvc cache dir` may have moved.

    Raises:
        UserError: this is not a DVC repository.
    """
    from dvc.exceptions import NotDvcRepoError
    from dvc.repo import Repo

    try:
        with Repo() as repository:
            return Path(repository.cache.local.path)
    except NotDvcRepoError as error:
        raise UserError("this is not a DVC repository; run the command in the root of the repository.") from error


def _hash(path: Path) -> str:
    digest = hashlib.md5(usedforsecurity=False)
    with path.open("rb") as source:
        while block := source.read(BLOCK):
            digest.update(block)
    return digest.hexdigest()


def damaged(cache: Path) -> Iterator[Path]:
    """Yield the cached files whose content does not match the hash in their name."""
    for path in sorted(cache.glob("??/*")):
        if path.is_file() and _hash(path) != (path.parent.name + path.name).removesuffix(".dir"):
            yield path


def checked_out(cache: Path, hashes: set[str]) -> list[Path]:
    """Return the outputs in `dvc.lock` that have, or contain a file with, one of the hashes.

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
    """Return the hashes of the files in a cached folder; none for a file, or if the folder's list is missing."""
    if not name.endswith(".dir"):
        return []
    try:
        return [item["md5"] for item in parse_json((cache / name[:2] / name[2:]).read_text())]
    except (OSError, ValueError, LookupError, TypeError):
        return []


def check(cache: Path) -> list[Path]:
    """Remove the damaged files and the outputs checked out from them; return all that was removed."""
    found = list(damaged(cache))
    spoilt = checked_out(cache, {path.parent.name + path.name for path in found})
    for path in found:
        path.chmod(0o644)
        path.unlink()
    for path in spoilt:
        shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
    return found + spoilt


@command("check_cache")
def main(arguments: list[str] | None = None) -> int:
    """Run the command; exit code 1: something was damaged."""
    argparse.ArgumentParser(prog="python -m tools.check_cache", description=__doc__).parse_args(arguments)
    removed = check(cache_folder())
    for path in removed:
        print(f"removed {path}: damaged, or checked out from a damaged file")
    print("`dvc repro` recomputes them" if removed else "every file in DVC's cache matches its hash")
    return 1 if removed else 0


if __name__ == "__main__":
    sys.exit(main())
