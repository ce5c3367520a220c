"""`python -m tools.publish results/paper`: keep a finished run as a published result.

Copies what names and measures the run to a folder that git keeps: parameters, `dvc.lock` (the fingerprint of every
input and output), metrics, costs, the heat maps, every trial's outcome, and the machine. With `--page`, the tables of
that page (`<!-- table: name -->`) are rewritten from it. The data stay in DVC's cache: `dvc push` shares them. Costs
are those of each stage's latest run, so publish one that computed every item (`./dev repro --force`).
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path

import pandas as pd
import yaml

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.flat import PAIR_TRIALS, read_flat
from pipeline.records.parameters import Parameters, read_parameters
from pipeline.records.series import STAGE
from pipeline.records.sources import OF_ALL_PAIRS
from pipeline.records.writing import whole_file
from pipeline.stages.running import command
from tools.machine import package_versions
from tools.published_tables import published_tables, with_tables

COPIED = (paths.PARAMETERS_FILE, Path("dvc.lock"), paths.SUMMARY_FILE, paths.DURATIONS_FILE)
COLUMNS = ["object0", "object1", "trial", "merged_id", "success", "success_10cm", "reason", "planning_attempts"]
TRIALS_FILE = "trials.csv"
MACHINE_FILE = "machine.json"


def require_up_to_date() -> None:
    """Raise a UserError unless every stage is up to date with the files that are there."""
    answer = subprocess.run([sys.executable, "-m", "dvc", "status", "--json"], capture_output=True, text=True)
    if answer.returncode:
        raise UserError(f"`dvc status` failed: {answer.stderr.strip().splitlines()[-1]}")
    stale = sorted(json.loads(answer.stdout or "{}"))
    if stale:
        raise UserError(f"{len(stale)} stages are not up to date ({stale[0]}, ...); run `./dev repro` first.")


def all_trials(parameters: Parameters) -> pd.DataFrame:
    """Return the rows of all trials; ``table`` is the source, or the series of trials under a condition.

    Raises:
        UserError: a table is missing or damaged.
    """
    files = {
        (source, first): (paths.trials_file(source, first), f"evaluate@{source}")
        for source in OF_ALL_PAIRS
        for first in parameters.tried_partners()
    }
    to_run = parameters.conditions.to_run(bool(parameters.reconstructed), parameters.evaluate, parameters.physics)
    files |= {(name, ""): (series.table, STAGE) for name, series in to_run.items()}
    parts = [read_flat(file, PAIR_TRIALS, stage)[COLUMNS].assign(table=key[0]) for key, (file, stage) in files.items()]
    return pd.concat(parts, ignore_index=True)[["table", *COLUMNS]]


def machine() -> dict[str, object]:
    """Return the machine of the run and the versions of its packages."""
    return {
        "system": f"{platform.system()} {platform.machine()}",
        "processor": processor(),
        "cores": len(os.sched_getaffinity(0)),
        "python": platform.python_version(),
        "packages": package_versions(),
    }


def processor() -> str:
    """Return the processor's name as the kernel reports it, or an empty string."""
    file = Path("/proc/cpuinfo")
    lines = file.read_text().splitlines() if file.exists() else []
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "")


def publish(folder: Path) -> None:
    """Copy a finished run to ``folder``.

    Raises:
        UserError: a stage is not up to date, or a file is missing.
    """
    require_up_to_date()
    trials = all_trials(read_parameters().with_assets())
    folder.mkdir(parents=True, exist_ok=True)
    for source in (*COPIED, *sorted(paths.FIGURES_FOLDER.glob("success-*.png"))):
        if not source.exists():
            raise UserError(f"{source} is missing; run `./dev repro` first.")
        with whole_file(folder / source.name) as temporary:
            shutil.copyfile(source, temporary)
    card = folder / paths.DATASET_CARD.name
    above = Path(os.path.relpath(".", folder)).as_posix()
    with whole_file(card) as temporary:
        temporary.write_text(paths.DATASET_CARD.read_text().replace("](../", f"]({above}/"))
    with whole_file(folder / TRIALS_FILE) as temporary:
        trials.to_csv(temporary, index=False, lineterminator="\n")
    with whole_file(folder / MACHINE_FILE) as temporary:
        temporary.write_text(json.dumps(machine(), indent=2) + "\n")


def tables_of(folder: Path) -> dict[str, str]:
    """Return the tables of a published result as Markdown, by name, from its own files.

    Raises:
        UserError: a file is missing or damaged.
    """
    try:
        summary, durations = (
            json.loads((folder / file.name).read_text()) for file in (paths.SUMMARY_FILE, paths.DURATIONS_FILE)
        )
        trials = pd.read_csv(folder / TRIALS_FILE, keep_default_na=False)
        parameters = yaml.safe_load((folder / paths.PARAMETERS_FILE.name).read_text())
        return published_tables(summary, durations, trials, parameters)
    except (OSError, ValueError, KeyError, TypeError, yaml.YAMLError) as error:
        raise UserError(f"{folder} is not a published result ({error}); publish a finished run there first.") from error


@command("publish")
def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m tools.publish", description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path, help="destination, such as results/paper")
    parser.add_argument("--page", type=Path, help="Markdown page whose tables are rewritten")
    parser.add_argument("--page-only", action="store_true", help="leave the folder as it is and only rewrite the page")
    chosen = parser.parse_args(arguments)
    if not chosen.page_only:
        publish(chosen.folder)
    if chosen.page:
        page = with_tables(chosen.page.read_text(), tables_of(chosen.folder))
        with whole_file(chosen.page) as temporary:
            temporary.write_text(page)
    print(f"{chosen.folder}: {', '.join(sorted(file.name for file in chosen.folder.iterdir()))}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
