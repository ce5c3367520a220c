"""What every step from samples to grasps is worth: refining, ranking, checks, physics (switches of ``train.sampling``).

    python benchmarks/learned_ablation.py --scale paper --pairs 8 --trials 10

Needs ``data/prepare`` and a trained model (``--model``); writes ``reports/learned_ablation.csv`` and prints it. All
rows begin with the same draws of a pair; each takes its first ``--grasps`` grasps and tries the first ``--trials`` of
them with the robot, one grasp per trial. (`evaluate` passes over a grasp for which no motion is found; here that is a
failure.) A trial's placement of the objects and its random numbers belong to the draw, so that the same grasp has the
same trial in every row and is carried out once.

penetration, contact distance: medians over the grasps of all pairs. objects overlap: share of grasps in which the
objects do. pass all checks: share that `merge` would accept, physics included. CPU s: to get the grasps of one pair.

Each finished pair leaves its rows in ``--folder``; the same command goes on after it.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402
from learned_objectives import chosen_pairs, commit, composed  # noqa: E402

import pipeline  # noqa: E402, F401  (sets the thread counts before numpy is imported)
from pipeline.energy.scene import compile_kernels  # noqa: E402
from pipeline.evaluate.grasps import SequenceGrasp, grasp_from_row  # noqa: E402
from pipeline.evaluate.trial import run_trial, trial_inputs  # noqa: E402
from pipeline.hand.model import Hand, load_hand  # noqa: E402
from pipeline.model.checkpoint import Checkpoint, read_checkpoint  # noqa: E402
from pipeline.model.network import GraspModel  # noqa: E402
from pipeline.pairing.task import task_of  # noqa: E402
from pipeline.records.digests import digest  # noqa: E402
from pipeline.records.kept import without_grid  # noqa: E402
from pipeline.records.objects import PreparedObject, load_prepared_object  # noqa: E402
from pipeline.records.parameters import Parameters  # noqa: E402
from pipeline.report.comparisons import ABLATION_FILE, write_comparison  # noqa: E402
from pipeline.sample.proposals import SampleRequest, check_sample, checked_pair, pair_energy  # noqa: E402
from pipeline.sample.quality import penetration_depth  # noqa: E402
from pipeline.sample.refinement import PairEnergy, Scored, refine  # noqa: E402
from pipeline.sample.sampling import sample_grasps  # noqa: E402
from pipeline.stages.seeds import item_seed  # noqa: E402


@dataclass(frozen=True)
class Steps:
    """Which steps a row takes; projection and clamping of joints are always on."""

    refine: bool
    rank: bool
    check: bool
    physics: bool


ROWS = {
    "as drawn": Steps(False, False, False, False),
    "refined": Steps(True, False, False, False),
    "refined, ranked": Steps(True, True, False, False),
    "refined, ranked, checked": Steps(True, True, True, False),  # all but physics
    "all: and held in physics": Steps(True, True, True, True),
    "all but refining": Steps(False, True, True, True),
    "all but ranking": Steps(True, False, True, True),
    "all but the checks": Steps(True, True, False, True),
}


def timed(function: Callable[[], Any]) -> tuple[Any, float]:
    """Return a result and its CPU seconds."""
    begin = time.process_time()
    result = function()
    return result, time.process_time() - begin


@dataclass
class Samples:
    """The draws of one pair, raw and refined, and what was found out about them; nothing is computed twice."""

    task: SampleRequest
    energy: PairEnergy
    states: dict[bool, Scored]  # by whether they are refined
    seconds: dict[bool, float]  # CPU s of drawing and scoring
    parameters: Parameters
    rows: dict[tuple[bool, bool, bool, int], tuple[dict[str, Any], float]] = field(default_factory=dict)
    outcomes: dict[tuple[int, str], str] = field(default_factory=dict)
    trial_seconds: float = 0.0

    def row_of(self, refined: bool, check: bool, physics: bool, index: int) -> tuple[dict[str, Any], float]:
        """Return the merged row of a draw, and the CPU seconds of making it."""
        key = (refined, check, physics, index)
        if key not in self.rows:
            settings = self.task.settings.model_copy(update={"check": check, "physics": physics})
            pair = checked_pair(self.task.pair, settings)
            self.rows[key] = timed(lambda: check_sample(pair, self.states[refined], index))
        return self.rows[key]

    def taken(self, steps: Steps, count: int) -> tuple[list[int], float]:
        """Return the first ``count`` draws that a row accepts, and the CPU seconds of finding them."""
        scored, seconds = self.states[steps.refine], self.seconds[steps.refine]
        order = np.argsort(scored.energy, kind="stable") if steps.rank else np.arange(len(scored.grasps))
        found: list[int] = []
        for index in order.tolist():
            if len(found) == count:
                break
            row, own = self.row_of(steps.refine, steps.check, steps.physics, index)
            seconds += own
            found += [index] if row["rejected_by"] == "" else []
        return found, seconds

    def outcome(self, index: int, row: dict[str, Any]) -> str:
        """Return why the trial of a draw's grasp failed; '' for a success."""
        grasp = grasp_from_row(row | {"merged_id": index}, self.task.pair.hand, self.task.pair.groups)
        key = (index, _content(grasp))
        if key not in self.outcomes:
            settings = self.parameters.evaluate.model_copy(
                update={"trials": len(self.states[True].grasps), "planning_attempts": 1}
            )
            objects = [without_grid(item) for item in self.task.pair.objects]
            own = self.parameters
            inputs = trial_inputs(
                "learned", self.task.pair.hand, own.picks, objects, [grasp], settings, own.physics, own.seed
            )
            result, seconds = timed(lambda: run_trial(inputs[index]))
            self.outcomes[key] = result["reason"]
            self.trial_seconds += seconds
        return self.outcomes[key]


def _content(grasp: SequenceGrasp) -> str:
    return digest(replace(grasp, merged_id=0))


def draw_samples(
    checkpoint: Checkpoint,
    model: GraspModel,
    parameters: Parameters,
    hand: Hand,
    objects: tuple[PreparedObject, PreparedObject],
    draws: int,
) -> Samples:
    """Draw and refine the samples of one pair, as the stage `sample` does."""
    settings, synthesize = parameters.train.sampling, parameters.synthesize
    names = objects[0].name, objects[1].name
    checks = parameters.merge, parameters.physics, parameters.validate_
    task = SampleRequest(
        pair=task_of(hand, parameters.picks, objects, *checks),
        points=(objects[0].surface_points, objects[1].surface_points),
        settings=settings,
        energy=synthesize.energy,
        styles=(synthesize.pinch, synthesize.side),
        seed=item_seed(parameters.seed, "train", "sample", *names) % 2**31,
    )
    energy = pair_energy(task)
    compile_kernels()
    (grasps, _), drawing = timed(
        lambda: sample_grasps(checkpoint, model, hand, task.points, draws, settings.sampler, settings.steps, task.seed)
    )
    rng = np.random.default_rng(task.seed)
    raw, scoring = timed(lambda: refine(energy, grasps, 0, settings.refine_step, rng))
    refined, refining = timed(lambda: refine(energy, grasps, settings.refine_iterations, settings.refine_step, rng))
    seconds = {False: drawing + scoring, True: drawing + refining}
    return Samples(task, energy, {False: raw, True: refined}, seconds, parameters)


def judge_pair(samples: Samples, count: int, trials: int) -> pd.DataFrame:
    """Return one line per row of the ablation and grasp that it takes."""
    lines: list[dict[str, Any]] = []
    for name, steps in ROWS.items():
        found, seconds = samples.taken(steps, count)
        scored = samples.states[steps.refine].chosen(np.array(found, dtype=np.int64))
        depths = [
            penetration_depth(
                samples.task.pair.hand, item, field, scored.grasps.T_hand_object[:, slot], scored.grasps.q
            )
            for slot, (item, field) in enumerate(zip(samples.energy.objects, samples.energy.fields, strict=True))
        ]
        depth = np.maximum(*depths)
        contact = np.mean([own.distance for own in scored.contacts], axis=0)
        for place, index in enumerate(found):
            row, _ = samples.row_of(steps.refine, steps.check, steps.physics, index)
            strict, _ = samples.row_of(steps.refine, True, True, index)
            lines.append(
                {
                    "steps": name,
                    "draw": index,
                    "penetration_mm": 1000 * depth[place],
                    "contact_mm": 1000 * contact[place],
                    "overlap": bool(scored.overlap[place] > 0),
                    "rejected_by": strict["rejected_by"],
                    "trial": samples.outcome(index, row) if place < trials else "not tried",
                }
            )
        lines.append({"steps": name, "draw": -1, "seconds": seconds, "trial": "not tried"})
    return pd.DataFrame(lines)


def summary(lines: pd.DataFrame) -> pd.DataFrame:
    """Return the table to publish from the lines of all pairs."""
    rows = []
    for name in ROWS:
        own = lines[lines["steps"] == name]
        grasps, tried = own[own["draw"] >= 0], own[own["trial"] != "not tried"]
        rows.append(
            {
                "steps": name,
                "grasps": len(grasps) / lines["pair"].nunique(),
                "penetration_mm": grasps["penetration_mm"].median(),
                "contact_mm": grasps["contact_mm"].median(),
                "objects_overlap": (grasps["overlap"].astype(str) == "True").mean(),
                "pass_checks": (grasps["rejected_by"] == "").mean(),
                "trials": len(tried),
                "success": (tried["trial"] == "").mean(),
                "no_motion": tried["trial"].str.startswith("plan").mean(),
                "seconds": own["seconds"].mean(),
            }
        )
    return pd.DataFrame(rows)


def main() -> None:
    """Sample, check, try, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scale", help="of conf/scale; default: the composed params.yaml")
    parser.add_argument("--model", type=Path, default=Path("models/train"), help="folder (default: %(default)s)")
    parser.add_argument("--pairs", type=int, default=8, help="half of them never trained, where there are any")
    parser.add_argument("--trials", type=int, default=10, help="per pair and row")
    parser.add_argument("--grasps", type=int, default=25, help="per pair and row")
    parser.add_argument("--folder", type=Path, default=Path("reports/unfinished"), help="for rows of single pairs")
    chosen = parser.parse_args()
    code = commit()
    parameters = composed(chosen.scale)
    hand = load_hand(parameters.hand)
    checkpoint = read_checkpoint(chosen.model)
    model = checkpoint.model()
    pairs = [(first, second) for first, seconds in parameters.partners().items() for second in seconds]
    unseen = [pair for pair in pairs if pair not in checkpoint.pairs]
    judged = [pairs[index] for index in chosen_pairs(pairs, unseen, chosen.pairs)]
    sections = [parameters.train.sampling, parameters.merge, parameters.physics, parameters.evaluate]
    digest = hashlib.sha256(" ".join(section.model_dump_json() for section in sections).encode())
    digest.update(f"{chosen.trials} {chosen.grasps} {parameters.seed}".encode())
    digest.update((chosen.model / "model.safetensors").read_bytes())
    parts, warm = [], False
    for names in judged:
        kept = chosen.folder / f"ablation-{digest.hexdigest()[:10]}-{'--'.join(names)}.csv"
        if not kept.exists():
            objects = load_prepared_object(names[0]), load_prepared_object(names[1])
            if not warm:  # imports and compiled kernels belong to no row
                draw_samples(checkpoint, model, parameters, hand, objects, draws=1).row_of(True, True, True, 0)
                warm = True
            begin = time.process_time()
            samples = draw_samples(checkpoint, model, parameters, hand, objects, parameters.train.sampling.draws)
            found = judge_pair(samples, chosen.grasps, chosen.trials).assign(pair="--".join(names))
            kept.parent.mkdir(parents=True, exist_ok=True)
            found.to_csv(kept.with_suffix(".tmp"), index=False)
            kept.with_suffix(".tmp").rename(kept)
            total = time.process_time() - begin
            spent = f"{samples.trial_seconds:.0f} of {total:.0f} CPU seconds"
            print(f"{kept.stem}: {len(samples.outcomes)} different trials in {spent}", flush=True)
        parts.append(pd.read_csv(kept, keep_default_na=False))
    lines = pd.concat(parts)
    numbers = ["penetration_mm", "contact_mm", "seconds"]  # empty texts are words elsewhere
    lines[numbers] = lines[numbers].apply(pd.to_numeric)
    table = summary(lines)
    options = {"scale": chosen.scale, "pairs": len(judged), "trials": chosen.trials, "grasps": chosen.grasps}
    words = " ".join(f"--{key} {value}" for key, value in options.items() if value is not None)
    never = sum(pair in unseen for pair in judged)
    history = pd.read_csv(chosen.model / "history.csv")
    facts = {
        "command": f"python benchmarks/learned_ablation.py {words}",
        "data": f"{parameters.scale} scale, model of {int(history['step'].iloc[-1])} steps; {len(judged)} pairs, "
        f"{never} of them never trained; {parameters.train.sampling.draws} draws of each",
        "commit": code,
    }
    write_comparison(ABLATION_FILE, table, facts)
    print(table.to_string(float_format=lambda value: f"{value:.3g}"))


if __name__ == "__main__":
    main()
