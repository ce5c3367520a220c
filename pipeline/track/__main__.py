"""Command of the record: gives MLflow the result that the report has just summed up, once per result."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.parameters import read_parameters, require_picks
from pipeline.records.writing import whole_file, write_json
from pipeline.stages.running import command, run_stage
from pipeline.stages.unfinished import remove_finished

LOCK_FILE, STAGES_FILE = Path("dvc.lock"), Path("dvc.yaml")
SURVIVAL_TABLE, SUCCESS_TABLE = Path("reports/survival.csv"), Path("reports/success.csv")


def read_file(source: Path, parse: Callable[[str], Any], mend: str) -> Any:
    """Return the parsed content of a file that another stage, or DVC, wrote.

    Raises:
        UserError: it is missing or damaged.
    """
    try:
        return parse(source.read_text())
    except FileNotFoundError as error:
        raise UserError(f"{source} is missing; {mend}.") from error
    except ValueError as error:
        raise UserError(f"{source} is damaged; delete it and {mend}.") from error


def work() -> None:
    """Read the summary, the parameters and ``dvc.lock``, and record them."""
    parameters = read_parameters()
    require_picks(parameters)
    from pipeline.track.files import curve_of_csv, mapping_of_json, mapping_of_yaml
    from pipeline.track.lock import COMPUTE, flatten, locked_stages, stage_names
    from pipeline.track.origin import origin_tags, record_root, run_name
    from pipeline.track.rates import csv_text, success_rows, survival_rows
    from pipeline.track.record import build_record
    from pipeline.track.runs import Origin, write_record

    again = "run `dvc repro -f -s report` to make it again"
    summary = read_file(paths.SUMMARY_FILE, mapping_of_json, again)
    durations = read_file(paths.DURATIONS_FILE, mapping_of_json, again) if paths.DURATIONS_FILE.exists() else {}
    lock = read_file(LOCK_FILE, mapping_of_yaml, f"`git checkout {LOCK_FILE}` and run `dvc repro` again")
    declared = read_file(STAGES_FILE, mapping_of_yaml, f"`git checkout {STAGES_FILE}`")
    curve = read_file(paths.MODEL_FOLDER / "history.csv", curve_of_csv, "run `dvc repro train` to make it again")
    chosen = parameters.model_dump(mode="json", by_alias=True, exclude={COMPUTE})
    stages = locked_stages(lock, stage_names(declared, chosen))
    record = build_record(summary, flatten(chosen), stages, durations, {"train": curve})
    kept = [paths.REPORT_PAGE, paths.SUMMARY_FILE, paths.PARAMETERS_FILE, LOCK_FILE]
    files = [file for file in kept if file.exists()]
    here = Path.cwd()
    origin = Origin(name=run_name(record.key), tags=origin_tags(here), files=files)
    done = write_record(record_root(here), parameters.track.experiment, record, origin)
    print(f"track: result {record.key[:12]} {done}")
    for table, header, rows in (
        (SURVIVAL_TABLE, "object", survival_rows(summary)),
        (SUCCESS_TABLE, "pair", success_rows(summary)),
    ):
        with whole_file(table) as temporary:
            temporary.write_text(csv_text(header, rows))
    write_json(paths.TRACKING_FILE, record.counts())
    remove_finished()


@command("track")
def work_all(server: str) -> int:
    """Record what git's history holds, on a server if one is named, and return the exit code."""
    parameters = read_parameters()
    from pipeline.track.backfill import record_all

    print(f"track: {record_all(Path.cwd(), parameters.track.experiment, server)}")
    return 0


def main() -> int:
    """Parse the command line and run the stage, or record the past."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.track", description=__doc__)
    parser.add_argument(
        "--all",
        action="store_true",
        help="record every distinct result of git's history and of DVC's experiments instead, in order of time, as a "
        "fresh clone's MLflow is empty; what is recorded stays, so that it can be run again at any time",
    )
    parser.add_argument(
        "--server", metavar="URL", default="", help="with --all: an MLflow server that records instead of mlflow.db"
    )
    chosen = parser.parse_args()
    if chosen.server and not (chosen.all and chosen.server.startswith(("http://", "https://"))):
        parser.error("--server takes an address such as http://mlflow:5000, and goes with --all")
    if chosen.all:
        return work_all(chosen.server)
    return run_stage("track", work)


if __name__ == "__main__":
    raise SystemExit(main())
