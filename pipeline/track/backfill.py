"""`python -m pipeline.track --all`: the results of git's history and of DVC's experiments, into MLflow."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from pipeline.records import paths
from pipeline.track.files import curve_of_csv
from pipeline.track.history import (
    Cache,
    NoResult,
    PastResult,
    Version,
    check_repository,
    open_cache,
    read_result,
    versions,
)
from pipeline.track.record import build_record
from pipeline.track.runs import COMPLETED, RECORDED, Origin, write_record

PAGE, CURVES = "its page", "its curves"


def record_all(root: Path, experiment: str, server: str = "") -> str:
    """Record every distinct result that is not yet recorded, in order of time, and return a sentence of counts.

    Prints one line for each that it records, and for each commit that it skips.

    Args:
        server: address of an MLflow server that records, instead of the database in ``root``.

    Raises:
        UserError: git, DVC or the database cannot be used.
    """
    check_repository(root)
    cache = open_cache(root)
    counts: Counter[str] = Counter()
    seen: set[str] = set()
    lacking: set[str] = set()
    for version in versions(root):
        counts["read"] += 1
        try:
            past = read_result(root, version)
        except NoResult as reason:
            counts["skipped"] += 1
            print(f"{version.title}: skipped, {reason}", flush=True)
            continue
        key, done, lacks = record_one(root, experiment, cache, version, past, seen, server)
        if lacks:
            lacking.add(key)
        if done in (RECORDED, COMPLETED):
            print(f"{version.title}: {done} as {key[:12]}" + (f", without {lacks}" if lacks else ""), flush=True)
        counts[done] += 1
        seen.add(key)
    return _sentence(counts, len(seen), len(lacking))


def record_one(
    root: Path,
    experiment: str,
    cache: Cache,
    version: Version,
    past: PastResult,
    seen: set[str],
    server: str = "",
) -> tuple[str, str, str]:
    """Record one result; return its key, what was done, and what it lacks.

    Args:
        seen: keys of results that were dealt with before: the first commit of a result counts.
    """
    curves, lacks = past_curves(cache, past)
    record = build_record(past.summary, past.parameters, past.stages, past.durations, curves)
    if record.key in seen:
        return record.key, "seen", ""
    with past_files(cache, past) as files:
        missing = [*([] if any(file.name == paths.REPORT_PAGE.name for file in files) else [PAGE]), *lacks]
        origin = Origin(
            name=version.experiment or record.key[:12],
            tags=past_tags(version),
            files=files,
            lacks=" and ".join(missing),
            began=float(version.seconds),
        )
        return record.key, write_record(root, experiment, record, origin, server), origin.lacks


def past_tags(version: Version) -> dict[str, str]:
    """Return the tags of a result of the past; versions of packages and the machine are not known any more."""
    when = datetime.fromtimestamp(version.seconds, UTC).strftime("%Y-%m-%d %H:%M UTC")
    tags = {
        "git.commit": version.commit,
        "mlflow.source.git.commit": version.commit,
        "mlflow.source.name": "git history",
        "mlflow.note.content": f"{version.subject}\n\nRead from git's history, commit of {when}.",
    }
    return tags | ({"dvc.experiment": version.experiment} if version.experiment else {})


def past_curves(cache: Cache, past: PastResult) -> tuple[dict[str, list[dict[str, float]]], list[str]]:
    """Return the curves per stage, and what is lacking: the training's history lies in the model's folder."""
    train = next((stage for stage in past.stages if stage.name == "train"), None)
    if train is None:
        return {}, []
    history = cache.member(train.outputs.get(str(paths.MODEL_FOLDER)), "history.csv")
    try:
        return ({"train": curve_of_csv(history.read_text())}, []) if history else ({}, [CURVES])
    except (OSError, ValueError):
        return {}, [CURVES]


@contextmanager
def past_files(cache: Cache, past: PastResult) -> Iterator[list[Path]]:
    """Make the files to keep with the record, under their own names, for as long as the context lasts."""
    page = None
    for stage in past.stages:
        page = cache.file(stage.outputs.get(str(paths.REPORT_PAGE))) or page
    with tempfile.TemporaryDirectory() as folder:
        summary = Path(folder) / paths.SUMMARY_FILE.name
        summary.write_text(json.dumps(past.summary, indent=2, sort_keys=True) + "\n")
        files = [summary]
        if page:
            files.append(Path(shutil.copyfile(page, Path(folder) / paths.REPORT_PAGE.name)))
        yield files


def _sentence(counts: Counter[str], results: int, lacking: int) -> str:
    said = (
        f"{counts['read']} commits and experiments hold {results} distinct results: {counts[RECORDED]} recorded now, "
        f"{results - counts[RECORDED]} before; {counts['skipped']} skipped"
    )
    if not lacking:
        return said
    return (
        f"{said}\n{lacking} are without page or curves, which are not in DVC's cache here; where a remote has them, "
        "`dvc fetch --all-commits reports/index.html models/train` and this command add them"
    )
