"""What each measure of a merged grasp costs, and how well it ranks grasps by robot trials at low friction.

    python benchmarks/robustness.py [--grasps 40] [--frictions 0.5 0.4 0.3]

Needs a finished run. Every accepted grasp of the first ``--grasps`` of each pair is tried once by the robot at every
friction of ``--frictions``, given to every two touching bodies: same placement, no other grasp in its place. Trials for
which no motion is found say nothing of the grasp and are left out. Every measure is computed anew, so that its cost is
known. ``reports/robustness_trials.csv`` and ``reports/robustness_measures.csv`` keep what was computed, one row per
trial and per grasp: an interrupted run carries on, and more grasps or frictions add to them; delete them after a change
of code or settings. Prints, and writes ``reports/robustness.csv``: a row per measure with its CPU seconds per grasp
and, per friction, the trials, the area under the ROC curve (0.5: chance) and Spearman's correlation with success.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402
from scipy.stats import mannwhitneyu, spearmanr  # noqa: E402

import pipeline  # noqa: E402, F401  (sets the thread counts before numpy is imported)
from pipeline.compute.fan_out import fan_out  # noqa: E402
from pipeline.evaluate.inputs import grasps_of, inputs_of, sections  # noqa: E402
from pipeline.evaluate.trial import TrialInput, run_trial  # noqa: E402
from pipeline.hand.model import load_hand  # noqa: E402
from pipeline.pairing.combination import Attempt, combine, planned_grasp, settled_grasp  # noqa: E402
from pipeline.pairing.grasps import SingleGrasp, validated_grasps  # noqa: E402
from pipeline.pairing.readiness import ready  # noqa: E402
from pipeline.pairing.task import Task, task_of  # noqa: E402
from pipeline.records import energy_terms, paths  # noqa: E402
from pipeline.records.objects import load_prepared_object  # noqa: E402
from pipeline.records.parameters import Parameters, chosen_sequences, load_parameters, read_parameters  # noqa: E402
from pipeline.records.parameters.physics import friction_of_all_contacts  # noqa: E402
from pipeline.records.tables import MARGINS, MERGED, VALIDATED, read_table, rows_of  # noqa: E402
from pipeline.robustness.friction import lowest_friction  # noqa: E402
from pipeline.robustness.measures import Measuring, margin_columns, measuring  # noqa: E402
from pipeline.robustness.survival import survived  # noqa: E402
from pipeline.stages.seeds import item_seed  # noqa: E402

SOURCE = "synthesized"
IDENTITY = ["objects", "merged_id"]
TRIALS, MEASURES = Path("reports/robustness_trials.csv"), Path("reports/robustness_measures.csv")
AT_ONCE = 16  # items between two additions to a file
LOW_IS_GOOD = ("drift", "lowest_friction", "margin_lowest_friction", "energy")


@dataclass(frozen=True)
class Case:
    """One merged grasp with what its measures need."""

    objects: str
    merged_id: int
    room: float  # m
    drift: float  # m, largest in the test of merge
    energies: dict[str, float]  # of the single grasps
    task: Task
    singles: tuple[SingleGrasp, ...]
    measuring: Measuring


def cases(parameters: Parameters, names: tuple[str, ...], count: int) -> list[Case]:
    """Return the first accepted grasps of a pair."""
    hand, styles = load_hand("allegro"), [pick.style for pick in parameters.picks]
    singles = [
        read_table(paths.validated_file(style, name), VALIDATED, f"validate@{style}")
        for style, name in zip(styles, names, strict=True)
    ]
    grasps = [{grasp.grasp_id: grasp for grasp in validated_grasps(table)} for table in singles]
    energies = [table.set_index("grasp_id")[list(energy_terms.COLUMNS.values())] for table in singles]
    objects = [load_prepared_object(name) for name in names]
    task = task_of(hand, parameters.picks, objects, parameters.merge, parameters.physics, parameters.validate_)
    own = measuring(parameters.robustness, parameters.seed, *names)
    rows = rows_of(read_table(paths.merged_file(names[0]), MERGED, "merge"), names)
    return [
        Case(
            objects="/".join(names),
            merged_id=int(row["merged_id"]),
            room=min(row["object_clearance"], row["hand_clearance"]),
            drift=float(np.max(row["gravity_drift"])),
            energies={
                f"{column} ({style})": float(table.at[number, column])
                for style, table, number in zip(styles, energies, row["grasp_ids"], strict=True)
                for column in table
            },
            task=task,
            singles=tuple(known[number] for known, number in zip(grasps, row["grasp_ids"], strict=True)),
            measuring=own,
        )
        for row in rows[rows["rejected_by"] == ""].head(count).to_dict("records")
    ]


def timed(function: Callable[[], Any]) -> tuple[Any, float]:
    """Return what a function returns and the CPU seconds that it took."""
    begin = time.process_time()
    found = function()
    return found, time.process_time() - begin


def weakest(margins: list[dict[str, float | None]]) -> dict[str, float]:
    """Return the margins of the object that is held worst, each by itself."""
    values = {
        name: [np.inf if margin is None else margin for margin in (own[name] for own in margins)]
        for name in MARGINS.names
    }
    return {name: (max if name in LOW_IS_GOOD else min)(own) for name, own in values.items()}


def measured(case: Case) -> dict[str, Any]:
    """Return all measures of a grasp, and ``cpu <measure>`` of those that cost something."""
    task, settings = case.task, case.measuring.settings
    attempt: Attempt = combine(task, [ready(task, number, single) for number, single in enumerate(case.singles)])
    planned, settled = planned_grasp(attempt), settled_grasp(attempt)
    margins, margin_cpu = timed(lambda: margin_columns(planned, task.physics, settings))
    lowest, lowest_cpu = timed(lambda: lowest_friction(settled, task.physics, task.validate, settings.ladder))
    outcomes, robustness_cpu = timed(
        lambda: survived(planned, case.measuring.conditions, task.physics, task.validate, settings)
    )
    return {
        "objects": case.objects,
        "merged_id": case.merged_id,
        "room": case.room,
        "drift": case.drift,
        **case.energies,
        **weakest(margins),
        **{f"cpu {name}": margin_cpu for name in MARGINS.names},
        "lowest_friction": lowest,
        "cpu lowest_friction": lowest_cpu,
        "robustness": float(np.mean(outcomes)),
        "cpu robustness": robustness_cpu,
    }


def trials_of(names: tuple[str, ...], count: int, friction: float) -> list[TrialInput]:
    """Return one trial of each of the first accepted grasps of a pair, and of no other grasp in its place."""
    parameters, hand = load_parameters(sections(SOURCE)), load_hand("allegro")
    physics = parameters["physics"].model_copy(update=friction_of_all_contacts(friction))
    template = inputs_of(SOURCE, names, {**parameters, "physics": physics}, hand)[0]
    grasps = sorted(grasps_of(SOURCE, names, parameters, hand), key=lambda grasp: grasp.merged_id)
    return [
        replace(
            template,
            trial=grasp.merged_id,
            grasps=(grasp,),
            settings=template.settings.model_copy(update={"planning_attempts": 1}),
            seed=item_seed(parameters["seed"], "robustness", *names, grasp.merged_id),
        )
        for grasp in grasps[:count]
    ]


def tried(friction: float, inputs: TrialInput) -> dict[str, Any]:
    """Run one trial; return how it ended."""
    row, cpu = timed(lambda: run_trial(inputs))
    return {
        "objects": "/".join(row["objects"]),
        "merged_id": inputs.trial,
        "friction": friction,
        "success": bool(row["success"]),
        "reason": row["reason"],
        "cpu": cpu,
    }


def kept(file: Path, wanted: Mapping[tuple[Any, ...], Callable[[], dict[str, Any]]], names: list[str]) -> pd.DataFrame:
    """Return the rows of all wanted items, those that a file lacks computed and added to it.

    Args:
        wanted: by the values of the columns ``names``, what computes the row.
    """
    known = (
        pd.read_csv(file, keep_default_na=False, na_values=["nan"]) if file.exists() else pd.DataFrame(columns=names)
    )
    there = set(known[names].itertuples(index=False, name=None))
    missing = [work for key, work in wanted.items() if key not in there]
    for begin in range(0, len(missing), AT_ONCE):
        rows = fan_out(_call, missing[begin : begin + AT_ONCE], read_parameters().compute.workers, file.stem)
        known = pd.concat([known, pd.DataFrame(rows)], ignore_index=True) if len(known) else pd.DataFrame(rows)
        known.to_csv(file, index=False, na_rep="nan")
    chosen = [key in wanted for key in known[names].itertuples(index=False, name=None)]
    return known[np.array(chosen, dtype=bool)]


def _call(work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    return work()


def ranking(values: np.ndarray, success: np.ndarray) -> tuple[float, float]:
    """Return the area under the ROC curve and Spearman's correlation; not a number without both outcomes."""
    if success.all() or not success.any():
        return float("nan"), float("nan")
    greater = mannwhitneyu(values[success], values[~success]).statistic
    ranks = spearmanr(values, success).statistic if len(set(values)) > 1 else float("nan")
    return greater / (success.sum() * (~success).sum()), float(ranks)


def table(measures: pd.DataFrame, trials: pd.DataFrame) -> Iterator[dict[str, Any]]:
    """Yield the row of every measure; those for which less is better with their sign turned."""
    of_grasp = measures.set_index(IDENTITY)
    planned = trials[~trials["reason"].str.startswith("plan")]
    for name in of_grasp.columns:
        if name.startswith("cpu "):
            continue
        sign = -1 if name.startswith(LOW_IS_GOOD) else 1
        cpu = of_grasp[f"cpu {name}"].mean() if f"cpu {name}" in of_grasp else 0.0
        row = {"measure": name, "cpu_seconds": cpu}
        for friction, own in planned.groupby("friction"):
            values = sign * of_grasp.loc[pd.MultiIndex.from_frame(own[IDENTITY]), name].to_numpy(np.float64)
            success = own["success"].to_numpy(bool)
            area, spearman = ranking(values, success)
            row |= {f"auc {friction}": area, f"spearman {friction}": spearman}
        yield row


def main() -> None:
    """Try, measure, rank, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--grasps", type=int, default=40, help="per pair (default: %(default)s)")
    parser.add_argument("--frictions", type=float, nargs="+", default=[0.5, 0.4, 0.3])
    chosen = parser.parse_args()
    parameters = read_parameters()
    known = {"seed": parameters.seed, "styles": parameters.styles, "pairs": parameters.pairs, "picks": parameters.picks}
    pairs = chosen_sequences(known)
    measures = {
        (case.objects, case.merged_id): partial(measured, case)
        for names in pairs
        for case in cases(parameters, names, chosen.grasps)
    }
    trials = {
        ("/".join(names), trial.trial, friction): partial(tried, friction, trial)
        for friction in chosen.frictions
        for names in pairs
        for trial in trials_of(names, chosen.grasps, friction)
    }
    outcomes = kept(TRIALS, trials, [*IDENTITY, "friction"])
    planned = outcomes[~outcomes["reason"].str.startswith("plan")]
    print(planned.groupby("friction")["success"].agg(trials="count", succeeded="sum").to_string())
    result = pd.DataFrame(table(kept(MEASURES, measures, IDENTITY), outcomes))
    result.to_csv("reports/robustness.csv", index=False)
    print(result.to_string(index=False, float_format=lambda value: f"{value:.3g}"))


if __name__ == "__main__":
    main()
