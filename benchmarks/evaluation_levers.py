"""What each way to make trials succeed is worth: the same pairs, numbers and seeds, one thing changed at a time.

    python benchmarks/evaluation_levers.py --pairs 16 --trials 6 [--condition mu_0_6] [--levers NAME ...]

Needs a finished run: the standard trials are read from ``data/evaluate`` (with ``--condition``: those of that
condition), the others are run on ``data/prepare`` and ``data/merge``. Writes ``reports/evaluation_levers.csv`` (with
``--condition``: ``reports/evaluation_levers_<condition>.csv``) and prints it. The first levers take away
what the standard trials have; the last choose other grasps of the same table. lost, gained: trials that succeed only
without, only with the change.

Each finished lever leaves its rows in ``--folder``; the same command goes on after it.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402

import pipeline  # noqa: E402, F401  (sets the thread counts before numpy is imported)
from pipeline.compute.fan_out import fan_out  # noqa: E402
from pipeline.evaluate.grasps import accepted_grasps  # noqa: E402
from pipeline.evaluate.trial import run_trial, trial_inputs  # noqa: E402
from pipeline.hand.model import load_hand  # noqa: E402
from pipeline.pairing.task import groups_of  # noqa: E402
from pipeline.records import paths  # noqa: E402
from pipeline.records.flat import PAIR_TRIALS, read_flat  # noqa: E402
from pipeline.records.kept import kept_object  # noqa: E402
from pipeline.records.parameters import Parameters, read_parameters  # noqa: E402
from pipeline.records.parameters.conditions import overridden  # noqa: E402
from pipeline.records.series import STAGE, TrialSeries  # noqa: E402
from pipeline.records.tables import MERGED, read_table, rows_of  # noqa: E402

Pair = tuple[str, str]
IDENTITY = ["object0", "object1", "trial"]
KEPT = [*IDENTITY, "merged_id", "success", "reason", "planning_attempts"]


def as_they_come(grasps: pd.DataFrame) -> pd.Series:
    """Return the order in which merge found them, which is random."""
    return grasps["merged_id"]


def least_drift(grasps: pd.DataFrame) -> pd.Series:
    """Return how far an object moved in the hand in the worst of six gravities, m."""
    return grasps["gravity_drift"].map(np.max)


def farthest_from_the_base(grasps: pd.DataFrame) -> pd.Series:
    """Return how near flange and mount come to the plane that the second object stands on, negative, m."""
    return -grasps["mount_clearance"]


@dataclass(frozen=True)
class Lever:
    """One change of the standard trials."""

    evaluate: dict[str, Any] = field(default_factory=dict)
    physics: dict[str, Any] = field(default_factory=dict)
    choose: Callable[[pd.DataFrame], pd.Series] | None = None  # the grasps with the smallest values are tried


LEVERS = {
    "one_attempt_at_planning": Lever(evaluate={"planning_attempts": 1}),
    "no_planning_margin": Lever(evaluate={"planning_margin": 0.0}),
    "own_entry_length_only": Lever(evaluate={"shorter_entries": []}),
    "no_rest_before_lifting": Lever(evaluate={"dwell_seconds": 0.0}),
    "fingers_close_in_0_3_s": Lever(evaluate={"close_seconds": 0.3}),
    "torque_of_the_simulator": Lever(physics={"hand_torque_limit": 50.0}),
    "grasps_as_they_come": Lever(choose=as_they_come),
    "grasps_of_least_drift": Lever(choose=least_drift),
    "grasps_with_the_highest_mount": Lever(choose=farthest_from_the_base),
}


def trials_of(lever: Lever, pair: Pair, parameters: Parameters, trials: int, condition: str) -> list[Any]:
    """Return the inputs of the first ``trials`` trials of one pair."""
    under = parameters.conditions.settings[condition] if condition else None
    evaluate = {**(under.evaluate if under else {}), **lever.evaluate}
    physics = {**(under.changes if under else {}), **lever.physics}
    table = rows_of(read_table(paths.merged_file(pair[0]), MERGED, "merge"), pair)
    hand = load_hand("allegro")
    grasps = accepted_grasps(table, hand, groups_of(hand, parameters.picks), parameters.evaluate.least_room)
    if lever.choose:
        passed = table[table["rejected_by"] == ""]
        order = passed.loc[lever.choose(passed).sort_values(kind="stable").index, "merged_id"]
        by_id = {grasp.merged_id: grasp for grasp in grasps}
        grasps = [by_id[number] for number in order]
    return trial_inputs(
        "synthesized",
        hand,
        parameters.picks,
        [kept_object(name, grid=False) for name in pair],
        grasps,
        overridden(parameters.evaluate, evaluate),
        overridden(parameters.physics, physics),
        parameters.seed,
    )[:trials]


def standard_trials(pairs: list[Pair], trials: int, condition: str) -> pd.DataFrame:
    """Return the rows of the first ``trials`` trials of every pair that the pipeline has run."""
    if condition:
        series = TrialSeries("synthesized", condition, read_parameters().physics.engine)
        rows = read_flat(series.table, PAIR_TRIALS, STAGE)
    else:
        files = dict.fromkeys(paths.trials_file("synthesized", first) for first, _ in pairs)
        rows = pd.concat([read_flat(file, PAIR_TRIALS, "evaluate@synthesized") for file in files])
    own = [pair in pairs for pair in zip(rows["object0"], rows["object1"], strict=True)]
    return rows.loc[np.array(own) & (rows["trial"] < trials), KEPT].reset_index(drop=True)


def spread(parameters: Parameters, count: int) -> list[Pair]:
    """Return ``count`` pairs: those of ``conditions.pairs`` first, then all others in order."""
    every = [(first, second) for first, seconds in parameters.partners().items() for second in seconds]
    return list(dict.fromkeys([*((first, second) for first, second in parameters.conditions.pairs), *every]))[:count]


def summary(outcomes: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """Return a row per lever: success, what is lost and gained against ``standard``, reasons, cost.

    Raises:
        ValueError: the trials of a lever are not those of the standard.
    """
    standard = outcomes["standard"].set_index(IDENTITY)["success"].astype(bool)
    rows = []
    for name, own in outcomes.items():
        success = own.set_index(IDENTITY)["success"].astype(bool)
        if not success.sort_index().index.equals(standard.sort_index().index):
            raise ValueError(f"{name} has other trials than the standard")
        before = standard.reindex(success.index)
        failed = own[~own["success"].astype(bool)]["reason"].value_counts()
        per_pair = own.groupby(["object0", "object1"])["success"].mean()
        row = {
            "lever": name,
            "trials": len(own),
            "success_rate_mean": per_pair.mean(),
            "success_rate_min_pair": per_pair.min(),
            "lost": int((before & ~success).sum()),
            "gained": int((~before & success).sum()),
            "other_grasp_planned": int((own["planning_attempts"] > 1).sum()),
            "reasons": "; ".join(f"{reason} {count}" for reason, count in failed.items()),
            "cpu_seconds_per_trial": own["seconds"].mean() if "seconds" in own else None,
        }
        rows.append(row)
    return pd.DataFrame(rows)


def _timed_trial(inputs: Any) -> dict[str, Any]:
    begin = time.process_time()
    row = run_trial(inputs)
    row |= dict(zip(IDENTITY, row["objects"], strict=False))
    return {name: row[name] for name in KEPT} | {"seconds": time.process_time() - begin}


def main() -> None:
    """Try, count, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=16, help="those of conditions.pairs first (default: %(default)s)")
    parser.add_argument("--trials", type=int, default=6, help="per pair and lever (default: %(default)s)")
    parser.add_argument("--condition", default="", help="under conditions.settings (default: the standard trials)")
    parser.add_argument("--levers", nargs="+", choices=list(LEVERS), default=list(LEVERS))
    parser.add_argument("--folder", type=Path, default=Path("reports/unfinished"), help="for rows of single levers")
    chosen = parser.parse_args()
    parameters = read_parameters()
    to_run = parameters.conditions.to_run(False, parameters.evaluate, parameters.physics).values()
    undrawn = {one.condition for one in to_run if not parameters.conditions.settings[one.condition].drawn}
    if chosen.condition and chosen.condition not in undrawn:
        parser.error(f"--condition must be one of {', '.join(sorted(undrawn))}")
    most = parameters.conditions.trials if chosen.condition else parameters.evaluate.trials
    if not 1 <= chosen.trials <= most:
        parser.error(f"--trials must be 1 to {most}, as many as the run has")
    hard = [(first, second) for first, second in parameters.conditions.pairs]
    pairs = hard[: chosen.pairs] if chosen.condition else spread(parameters, chosen.pairs)
    digest = hashlib.sha256(f"{parameters.seed} {chosen.trials} {pairs} {chosen.condition}".encode())
    for section in (parameters.evaluate, parameters.physics, parameters.conditions):
        digest.update(section.model_dump_json().encode())
    for first in dict.fromkeys(first for first, _ in pairs):
        digest.update(paths.merged_file(first).read_bytes())
    outcomes = {"standard": standard_trials(pairs, chosen.trials, chosen.condition)}
    for name in chosen.levers:
        kept = chosen.folder / f"levers-{digest.hexdigest()[:10]}-{name}.csv"
        if not kept.exists():
            inputs = [
                trial
                for pair in pairs
                for trial in trials_of(LEVERS[name], pair, parameters, chosen.trials, chosen.condition)
            ]
            found = pd.DataFrame(fan_out(_timed_trial, inputs, parameters.compute.workers, name))
            kept.parent.mkdir(parents=True, exist_ok=True)
            found.to_csv(kept.with_suffix(".tmp"), index=False)
            kept.with_suffix(".tmp").rename(kept)
        outcomes[name] = pd.read_csv(kept, keep_default_na=False)
    table = summary(outcomes)
    target = Path(f"reports/evaluation_levers{'_' + chosen.condition if chosen.condition else ''}.csv")
    table.to_csv(target, index=False)
    print(table.to_string(float_format=lambda value: f"{value:.3g}"))


if __name__ == "__main__":
    main()
