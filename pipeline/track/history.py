"""Results of the past: what git's history and DVC's experiments hold of them, read through git."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.track.files import mapping_of_json, mapping_of_yaml
from pipeline.track.lock import COMPUTE, LockedStage, flatten, locked_stages, stage_names

LOCK_FILE, STAGES_FILE = Path("dvc.lock"), Path("dvc.yaml")
# DVC keeps the tip of every experiment under refs/exps/<2 letters>/<38 letters>/<name>, and its own notes beside them.
EXPERIMENT_PARTS = 5


class NoResult(Exception):
    """A commit holds no result that could be recorded; the text says why."""


@dataclass(frozen=True)
class Version:
    """A commit that may hold a result."""

    commit: str
    seconds: int  # of the commit, since 1970
    subject: str
    experiment: str = ""  # name of the DVC experiment

    @property
    def title(self) -> str:
        """A few words for a line of output."""
        return f"{self.commit[:7]} " + (f"[{self.experiment}]" if self.experiment else self.subject)


@dataclass(frozen=True)
class PastResult:
    """What one commit holds of a result."""

    summary: dict[str, Any]
    parameters: dict[str, Any]  # flat: as the stages declared them, the others as the commit states them
    stages: list[LockedStage]
    durations: dict[str, dict[str, float]]


def _git(root: Path, *arguments: str) -> bytes:
    try:
        done = subprocess.run(["git", *arguments], cwd=root, capture_output=True, timeout=600)
    except FileNotFoundError as error:
        raise UserError("git is not installed, and --all reads its history; install git.") from error
    if done.returncode != 0:
        raise UserError(f"git {arguments[0]} failed: {' '.join(done.stderr.decode(errors='replace').split())[:300]}.")
    return done.stdout


def check_repository(root: Path) -> None:
    """Check that the whole history is there.

    Raises:
        UserError: there is no git, no repository, no commit, or only a part of the history.
    """
    try:
        shallow = _git(root, "rev-parse", "--is-shallow-repository").decode().strip()
    except UserError as error:
        if "not a git repository" in str(error):
            raise UserError(f"{root} is no git repository, and --all reads its history; run it in a clone.") from error
        raise
    if shallow == "true":
        raise UserError("this clone is shallow, so its history is cut off; `git fetch --unshallow`, then run it again.")
    if not _git(root, "for-each-ref", "--count=1"):
        raise UserError("there is no commit yet, so there is no history to read.")


def versions(root: Path) -> list[Version]:
    """Return the commits of all branches that changed a result, and the DVC experiments, in order of time."""
    form = "--format=%H%x00%ct%x00%s"
    files = [str(LOCK_FILE), str(paths.SUMMARY_FILE)]
    refs = ["HEAD", "--branches", "--remotes", "--tags"]
    found = [_version(line) for line in _lines(_git(root, "log", "--full-history", form, *refs, "--", *files))]
    for line in _lines(_git(root, "for-each-ref", "--format=%(refname)", "refs/exps")):
        parts = line.split("/")
        if len(parts) == EXPERIMENT_PARTS and len(parts[2]) == 2:
            (tip,) = _lines(_git(root, "log", "-1", form, line))
            found.append(_version(tip, parts[-1]))
    return sorted(found, key=lambda version: (version.seconds, bool(version.experiment)))


def _lines(output: bytes) -> list[str]:
    return output.decode(errors="replace").splitlines()


def _version(line: str, experiment: str = "") -> Version:
    commit, seconds, subject = line.split("\0", 2)
    return Version(commit, int(seconds), subject, experiment)


def read_result(root: Path, version: Version) -> PastResult:
    """Return what a commit holds of a result.

    Raises:
        NoResult: something is missing, or does not belong together.
    """
    content = _files_of(root, version.commit)
    lock = _parsed(content, LOCK_FILE, mapping_of_yaml)
    summary = _parsed(content, paths.SUMMARY_FILE, mapping_of_json)
    declared = _parsed(content, STAGES_FILE, mapping_of_yaml)
    chosen = _parsed(content, paths.PARAMETERS_FILE, mapping_of_yaml)
    try:
        stages = locked_stages(lock, stage_names(declared, chosen))
    except (ValueError, TypeError, AttributeError, KeyError) as error:
        raise NoResult(f"its stages are unknown: {error}") from error
    report = next((stage for stage in stages if stage.name == "report"), None)
    if report is None:
        raise NoResult(f"its {LOCK_FILE} has no report")
    written = hashlib.md5(content[str(paths.SUMMARY_FILE)], usedforsecurity=False).hexdigest()
    if report.outputs.get(str(paths.SUMMARY_FILE)) != written:
        raise NoResult(f"its {paths.SUMMARY_FILE} is not the one that {LOCK_FILE} names")
    parameters = flatten({name: value for name, value in chosen.items() if name != COMPUTE})
    for stage in stages:
        parameters |= stage.parameters
    return PastResult(summary, parameters, stages, _durations(content))


def _files_of(root: Path, commit: str) -> dict[str, bytes]:
    """Return the files of a commit that a record is made of; those that it lacks are left out."""
    wanted = [LOCK_FILE, STAGES_FILE, paths.PARAMETERS_FILE, paths.SUMMARY_FILE, paths.DURATIONS_FILE]
    there = set(_lines(_git(root, "ls-tree", "--full-tree", "-r", "--name-only", commit, "--", *map(str, wanted))))
    return {str(file): _git(root, "show", f"{commit}:{file}") for file in wanted if str(file) in there}


def _parsed(content: Mapping[str, bytes], file: Path, parse: Any) -> dict[str, Any]:
    if str(file) not in content:
        raise NoResult(f"it has no {file}")
    try:
        return dict(parse(content[str(file)]))
    except ValueError as error:
        raise NoResult(f"its {file} is damaged") from error


def _durations(content: Mapping[str, bytes]) -> dict[str, dict[str, float]]:
    """Return the durations of the stages; they are a help, so that damaged ones are left out."""
    try:
        found = mapping_of_json(content[str(paths.DURATIONS_FILE)])
    except (KeyError, ValueError):
        return {}
    return {
        name: {key: float(value) for key, value in entry.items() if isinstance(value, int | float)}
        for name, entry in found.items()
        if isinstance(entry, dict)
    }


@dataclass(frozen=True)
class Cache:
    """DVC's cache, from which files of past results are taken where they are there."""

    folder: Path

    def file(self, fingerprint: str | None) -> Path | None:
        """Return the file with this hash, or None."""
        if not fingerprint:
            return None
        place = self.folder / "files" / "md5" / fingerprint[:2] / fingerprint[2:]
        return place if place.is_file() else None

    def member(self, fingerprint: str | None, name: str) -> Path | None:
        """Return one file of a folder with this hash, or None."""
        listing = self.file(fingerprint)
        if listing is None:
            return None
        try:
            return next(
                (self.file(entry["md5"]) for entry in json.loads(listing.read_text()) if entry["relpath"] == name), None
            )
        except (ValueError, TypeError, KeyError):
            return None


def open_cache(root: Path) -> Cache:
    """Return the cache that DVC uses here.

    Raises:
        UserError: DVC does not say where it is.
    """
    command = [sys.executable, "-m", "dvc", "cache", "dir"]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, timeout=120)
    if done.returncode != 0:
        raise UserError(f"`dvc cache dir` failed: {' '.join(done.stderr.split())[:300]}.")
    return Cache(Path(done.stdout.strip().splitlines()[-1]))
