"""`python -m tools.history`: write benchmarks/history.csv, a row per published run, from what git keeps of each.

A run is published when its figures are committed: the demo's in reports/, others under results/. Run it after such a
commit. CPU seconds are those of each stage's latest run on the machine that published it; they compare runs of one
machine only.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.sources import SOURCES
from pipeline.records.writing import whole_file
from pipeline.stages.running import command

HISTORY_FILE = Path("benchmarks/history.csv")
RESULTS_FOLDER = "results"
# Columns of rates, and the keys of summary.json that they are taken from.
RATES = {
    "survival_rate": "validate.survival_rate_mean",
    "merged_grasps": "merge.grasps",
    **{f"success_rate_{source}": f"evaluate.{source}.success_rate_mean" for source in SOURCES},
}
COSTS = ("cpu_seconds_per_validated_grasp", "cpu_seconds_per_trial")
COLUMNS = ("date", "commit", "folder", "scale", *RATES, *COSTS)
# Stages by the names that they have had: by style and source, before that by object as well.
SINGLE_GRASPS = re.compile(r"(synthesize|validate)[@-]")
TRIALS = re.compile(rf"evaluate[@-]({'|'.join(SOURCES)})\b")


def row_of(summary: Mapping[str, Any], durations: Mapping[str, Mapping[str, float]]) -> dict[str, Any]:
    """Return what is kept of one run; None where it has no such figure.

    Args:
        summary: the content of summary.json.
        durations: the content of durations.json.
    """

    def cost(stages: re.Pattern[str], units: float | None) -> float | None:
        seconds = sum(own["cpu_seconds"] for name, own in durations.items() if stages.match(name))
        return round(seconds / units, 3) if seconds and units else None

    trials = sum(summary.get(f"evaluate.{source}.trials", 0) for source in SOURCES)
    costs = cost(SINGLE_GRASPS, summary.get("validate.validated")), cost(TRIALS, trials)
    rates = {column: summary.get(key) for column, key in RATES.items()}
    return {"scale": summary["scale"], **rates, **dict(zip(COSTS, costs, strict=True))}


def published_runs() -> Iterator[dict[str, Any]]:
    """Yield a row for every commit that changed the summary of a published run, the oldest first.

    Raises:
        UserError: git does not know the history.
    """
    summary, durations = paths.SUMMARY_FILE.name, paths.DURATIONS_FILE.name
    places = [str(paths.SUMMARY_FILE), f"{RESULTS_FOLDER}/*/{summary}"]
    log = _git(
        "log", "--reverse", "--format=%x00%h %cs", "--name-only", "--diff-filter=AM", "--abbrev=7", "--", *places
    )
    for block in log.split("\0")[1:]:
        head, *files = block.split("\n")
        commit, date = head.split()
        for file in filter(None, files):
            folder = str(Path(file).parent)
            content = [json.loads(_git("show", f"{commit}:{folder}/{name}")) for name in (summary, durations)]
            yield {"date": date, "commit": commit, "folder": folder, **row_of(*content)}


def _git(*arguments: str) -> str:
    done = subprocess.run(["git", *arguments], capture_output=True, text=True)
    if done.returncode:
        raise UserError(
            f"`git {arguments[0]}` failed ({done.stderr.strip()[:200]}); run this in a clone with its history."
        )
    return done.stdout


@command("history")
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command."""
    if arguments or sys.argv[1:]:
        raise UserError("takes no arguments; run `python -m tools.history`.")
    rows = pd.DataFrame(list(published_runs()), columns=list(COLUMNS))
    if rows.empty:
        raise UserError(f"git knows no commit of {paths.SUMMARY_FILE}; run this in a clone with its history.")
    with whole_file(HISTORY_FILE) as temporary:
        rows.to_csv(temporary, index=False)
    print(f"{HISTORY_FILE}: {len(rows)} published runs")
    return 0


if __name__ == "__main__":
    sys.exit(main())
