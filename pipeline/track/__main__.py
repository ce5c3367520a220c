"""Command of the record: tells MLflow about the result that the report has just summed up, once per result."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.parameters import load_parameters
from pipeline.records.running import run_stage
from pipeline.records.texts import parse_json, parse_yaml
from pipeline.records.writing import write_json

LOCK_FILE = Path("dvc.lock")


def sections() -> list[str]:
    """Parameter sections that the stage declares: all, except ``compute``, on which no result depends."""
    shown = ["scale", "seed", "styles", "objects", "meshes", "renderings", "captures", "reconstructed"]
    single = ["prepare", "synthesize", "physics", "validate"]
    return [*shown, *single, "merge", "train", "evaluate", "harder", "reconstruct", "report", "track"]


def read_json(source: Path, made_by: str) -> dict[str, Any]:
    """Read a JSON file that another stage wrote.

    Raises:
        UserError: it is missing or damaged.
    """
    mend = f"run `dvc repro -f -s {made_by}` to make it again"
    try:
        content = parse_json(source.read_text())
    except FileNotFoundError as error:
        raise UserError(f"{source} is missing; {mend}.") from error
    except ValueError as error:
        raise UserError(f"{source} is damaged; delete it and {mend}.") from error
    if not isinstance(content, dict):
        raise UserError(f"{source} is damaged; delete it and {mend}.")
    return content


def read_lock() -> dict[str, Any]:
    """Read ``dvc.lock``, which DVC keeps up to date for every stage that ended before this one.

    Raises:
        UserError: it is missing or damaged.
    """
    import yaml

    try:
        content = parse_yaml(LOCK_FILE.read_text())
    except FileNotFoundError as error:
        raise UserError(f"{LOCK_FILE} is missing; run `dvc repro`, which writes it.") from error
    except yaml.YAMLError as error:
        raise UserError(f"{LOCK_FILE} is damaged; `git checkout {LOCK_FILE}` and run `dvc repro` again.") from error
    if not isinstance(content, dict):
        raise UserError(f"{LOCK_FILE} is damaged; `git checkout {LOCK_FILE}` and run `dvc repro` again.")
    return content


def read_curve() -> list[dict[str, float]]:
    """Read the losses on the way of the training.

    Raises:
        UserError: the file is missing or damaged.
    """
    import csv

    source = paths.MODEL_FOLDER / "history.csv"
    try:
        with source.open(newline="") as lines:
            return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(lines)]
    except (OSError, ValueError, TypeError) as error:
        raise UserError(f"{source} is missing or damaged; run `dvc repro train` to make it again.") from error


def plain(value: Any) -> Any:
    """Return typed parameters as plain data."""
    if hasattr(value, "model_dump"):
        return value.model_dump(mode="json", by_alias=True)
    if isinstance(value, dict):
        return {name: plain(content) for name, content in value.items()}
    return value


def work() -> None:
    """Read the summary, the parameters and ``dvc.lock``, and record them."""
    parameters = {name: plain(content) for name, content in load_parameters(sections()).items()}
    from pipeline.track.lock import flatten, locked_stages, stage_names
    from pipeline.track.origin import origin_tags
    from pipeline.track.record import build_record
    from pipeline.track.store import write_record

    summary = read_json(paths.SUMMARY_FILE, "report")
    names = stage_names(
        parameters["styles"],
        parameters["objects"],
        parameters["meshes"],
        paths.SOURCES,
        parameters["renderings"],
        parameters["captures"],
        parameters["reconstructed"],
        parameters["harder"]["settings"],
    )
    durations = read_json(paths.DURATIONS_FILE, "report") if paths.DURATIONS_FILE.exists() else {}
    curves = {"train": read_curve()}
    record = build_record(summary, flatten(parameters), locked_stages(read_lock(), names), durations, curves)
    pages = [paths.REPORT_PAGE, paths.SUMMARY_FILE]
    new = write_record(
        Path.cwd(),
        parameters["track"]["experiment"],
        record,
        origin_tags(Path.cwd()),
        [page for page in pages if page.exists()],
    )
    print(f"track: result {record.key[:12]} " + ("recorded" if new else "was recorded before, nothing added"))
    write_json(paths.TRACKING_FILE, record.counts())


def main() -> int:
    """Parse the command line and run the stage."""
    argparse.ArgumentParser(prog="python -m pipeline.track", description=__doc__).parse_args()
    return run_stage("track", work)


if __name__ == "__main__":
    raise SystemExit(main())
