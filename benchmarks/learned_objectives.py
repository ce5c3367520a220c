"""Which objective and sampler give the best grasps per CPU second: trains every objective with several seeds.

    python benchmarks/learned_objectives.py --scale paper

Reads ``data/prepare`` and ``data/merge``; writes ``reports/learned_objectives.csv`` and prints it. Every training has
the same network and the same number of steps, so the same CPU time; samplers differ in theirs. Samples are judged as
drawn, and once more after the refinement of ``train.sampling``; nothing is ranked or checked.

usable: hand and objects overlap at most 1 mm, contacts at most 2 mm off on average, objects apart. Shares are means
over pairs and seeds, lengths are means of the medians of pairs. Half of the pairs are of train.data.held_out_pairs.

Each finished training leaves its rows in ``--folder``; the same command goes on after it.
"""

from __future__ import annotations

import argparse
import hashlib
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402

import pipeline  # noqa: E402, F401  (sets the thread counts before numpy is imported)
from pipeline.energy.scene import compile_kernels  # noqa: E402
from pipeline.hand.model import load_hand  # noqa: E402
from pipeline.model.checkpoint import Checkpoint  # noqa: E402
from pipeline.model.representation import GraspBatch  # noqa: E402
from pipeline.records import paths  # noqa: E402
from pipeline.records.flat import PAIR_GRASPS, pair_rows, read_flat  # noqa: E402
from pipeline.records.objects import load_prepared_object  # noqa: E402
from pipeline.records.parameters import Parameters, read_parameters  # noqa: E402
from pipeline.records.parameters.train import DiffusionParameters, SamplingParameters, TrainingParameters  # noqa: E402
from pipeline.report.comparisons import OBJECTIVES_FILE, write_comparison  # noqa: E402
from pipeline.sample.quality import grasp_distances, penetration_depth  # noqa: E402
from pipeline.sample.refinement import PairEnergy, Scored, refine  # noqa: E402
from pipeline.sample.sampling import CLOUDS, grasps_from_clouds, sampled_clouds  # noqa: E402
from pipeline.train.data import Examples, gather_examples  # noqa: E402
from pipeline.train.training import train  # noqa: E402
from tools.scales import compose  # noqa: E402

OBJECTIVES = {
    "clean": DiffusionParameters(objective="clean", schedule="cosine"),
    "flow": DiffusionParameters(objective="flow", schedule="cosine"),
    "epsilon": DiffusionParameters(objective="epsilon", schedule="cosine"),
    "epsilon, published schedule": DiffusionParameters(objective="epsilon", schedule="published"),
}
SAMPLERS = [("ddim", 20), ("dpm", 10), ("dpm", 20), ("ancestral", 20), ("ancestral", 100)]
USABLE_DEPTH, USABLE_CONTACT = 0.001, 0.002  # m


def composed(scale: str | None) -> Parameters:
    """Return the parameters of a scale, or those of params.yaml."""
    if scale is None:
        return read_parameters()
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "params.yaml"
        compose(scale, target)
        return read_parameters(target)


def commit() -> str:
    """Return the commit of the code, and whether files differ from it."""
    words = ["git", "describe", "--always", "--dirty", "--abbrev=10", "--exclude=*"]
    return subprocess.run(words, cwd=Path(__file__).parent, capture_output=True, text=True, check=True).stdout.strip()


def chosen_pairs(pairs: Sequence[tuple[str, str]], unseen: Sequence[Sequence[str]], count: int) -> list[int]:
    """Return up to ``count`` pairs, by index: half of them unseen, if there are as many; objects spread evenly."""
    firsts, seconds = (list(dict.fromkeys(names)) for names in zip(*pairs, strict=True))
    is_unseen = [list(pair) in [list(own) for own in unseen] for pair in pairs]
    # Diagonals of the table of pairs: one diagonal holds every object once.
    diagonal = [(seconds.index(b) - firsts.index(a)) % len(seconds) for a, b in pairs]
    from_top = sorted(range(len(pairs)), key=lambda index: (diagonal[index], index))
    kept = [index for index in from_top if is_unseen[index]][: count // 2]
    from_bottom = sorted(range(len(pairs)), key=lambda index: (diagonal[index], -index))
    others = [index for index in from_bottom if not is_unseen[index]][: count - len(kept)]
    return sorted(kept + others)


def usable(energy: PairEnergy, scored: Scored) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return which samples (B,) are usable, their deepest overlaps (B,) and mean distances of contacts (B,), m."""
    hand, grasps = energy.hand, scored.grasps
    depth = np.maximum(
        *[
            penetration_depth(hand, item, energy.fields[slot], grasps.T_hand_object[:, slot], grasps.q)
            for slot, item in enumerate(energy.objects)
        ]
    )
    contact = np.mean([own.distance for own in scored.contacts], axis=0)
    return (depth <= USABLE_DEPTH) & (contact <= USABLE_CONTACT) & (scored.overlap == 0), depth, contact


def judge(energy: PairEnergy, grasps: GraspBatch, known: GraspBatch, refining: tuple[int, float]) -> dict[str, float]:
    """Return figures of one pair's samples; ``known`` are grasps of that pair in the data."""
    hand = energy.hand
    good, depth, contact = usable(energy, refine(energy, grasps, 0, 0.001, np.random.default_rng(0)))
    refined, _, _ = usable(energy, refine(energy, grasps, *refining, np.random.default_rng(0)))
    among = grasp_distances(hand, grasps, grasps)
    return {
        "usable": float(good.mean()),
        "usable_refined": float(refined.mean()),
        "overlap_mm": 1000 * float(np.median(depth)),
        "contact_mm": 1000 * float(np.median(contact)),
        "spread_mm": 1000 * float(np.median(among[np.triu_indices(len(among), 1)])),
        "to_data_mm": 1000 * float(np.median(grasp_distances(hand, grasps, known).min(1))),
    }


def judge_samplers(
    checkpoint: Checkpoint,
    examples: Examples,
    energies: dict[int, PairEnergy],
    settings: SamplingParameters,
    samples: int,
    seed: int,
) -> list[dict[str, object]]:
    """Return one row per sampler and pair."""
    model, rows = checkpoint.model(), []
    for index, energy in energies.items():
        points = (energy.objects[0].surface_points, energy.objects[1].surface_points)
        begin = time.process_time()
        clouds = sampled_clouds(checkpoint, points, min(CLOUDS, samples), seed)
        preparing = time.process_time() - begin
        for sampler, steps in SAMPLERS:
            begin = time.process_time()
            grasps, _ = grasps_from_clouds(checkpoint, model, energy.hand, clouds, samples, sampler, steps, seed)
            sampling = time.process_time() - begin
            trained = examples.pairs[index] in checkpoint.pairs
            known = examples.grasps[(examples.pair == index) & ((examples.split == "training") | (not trained))]
            figures = judge(energy, grasps, known, (settings.refine_iterations, settings.refine_step))
            own = {"sampler": f"{sampler} {steps}", "pair": "--".join(examples.pairs[index]), "unseen": not trained}
            rows.append(own | figures | {"sampling_seconds": sampling, "clouds_seconds": preparing})
    return rows


def summary(table: pd.DataFrame, samples: int) -> pd.DataFrame:
    """Return the table to publish from rows of single pairs."""
    keys = ["objective", "sampler"]
    plain = [
        "overlap_mm",
        "contact_mm",
        "spread_mm",
        "to_data_mm",
        "training_seconds",
        "clouds_seconds",
        "sampling_seconds",
    ]
    rows = []
    for (objective, sampler), own in table.groupby(keys, sort=False):
        seeds = own.groupby("seed")["usable"].mean()
        rows.append(
            {
                "objective": objective,
                "sampler": sampler,
                "usable": own["usable"].mean(),
                "usable_least": seeds.min(),
                "usable_most": seeds.max(),
                "usable_unseen": own.loc[own["unseen"], "usable"].mean(),
                "usable_refined": own["usable_refined"].mean(),
                **{name: own[name].mean() for name in plain},
                "usable_per_second": samples
                * own["usable"].mean()
                / (own["clouds_seconds"] + own["sampling_seconds"]).mean(),
            }
        )
    return pd.DataFrame(rows)


def main() -> None:
    """Train, sample, judge, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scale", help="of conf/scale; default: the composed params.yaml")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--steps", type=int, default=1500)
    parser.add_argument("--pairs", type=int, default=16, help="to judge on; trained is on all")
    parser.add_argument("--samples", type=int, default=25, help="per pair")
    parser.add_argument("--width", type=int, default=256, help="of the denoiser")
    parser.add_argument("--blocks", type=int, default=3, help="of the denoiser")
    parser.add_argument("--batch", type=int, default=128)
    parser.add_argument("--folder", type=Path, default=Path("reports/unfinished"), help="for rows of single trainings")
    chosen = parser.parse_args()
    code = commit()
    parameters = composed(chosen.scale)
    hand = load_hand(parameters.hand)
    partners, settings = parameters.partners(), parameters.train
    pairs = [(first, second) for first, seconds in partners.items() for second in seconds]
    objects = {name: load_prepared_object(name) for name in dict.fromkeys(name for pair in pairs for name in pair)}
    merged = {first: read_flat(paths.merged_file(first), PAIR_GRASPS, "merge") for first in dict(pairs)}
    tables = {pair: pair_rows(merged[pair[0]], pair[1]) for pair in pairs}
    examples = gather_examples(tables, objects, settings.data, settings.encoder, parameters.seed)
    judged = chosen_pairs(examples.pairs, settings.data.held_out_pairs, chosen.pairs)
    energies = {
        index: PairEnergy(
            (objects[examples.pairs[index][0]], objects[examples.pairs[index][1]]),
            parameters.synthesize.energy,
            (parameters.synthesize.pinch, parameters.synthesize.side),
            parameters.merge.clearance,
            hand,
        )
        for index in judged
    }
    compile_kernels()
    optimization = {"steps": chosen.steps, "record_every": chosen.steps, "batch": chosen.batch}
    lean = {
        "denoiser": settings.denoiser.model_copy(update={"width": chosen.width, "blocks": chosen.blocks}),
        "optimization": settings.optimization.model_copy(update=optimization),
    }
    rows: list[pd.DataFrame] = []
    for seed in range(1, chosen.seeds + 1):  # seed by seed: a run that is cut short compares all objectives
        for name, diffusion in OBJECTIVES.items():
            own = TrainingParameters(data=settings.data, encoder=settings.encoder, diffusion=diffusion, **lean)
            digest = hashlib.sha256(f"{own.model_dump_json()} {judged} {chosen.samples} {SAMPLERS}".encode())
            digest.update(examples.grasps.q.tobytes())
            kept = chosen.folder / f"objectives-{digest.hexdigest()[:10]}-{seed}.csv"
            if not kept.exists():
                begin = time.process_time()
                with tempfile.TemporaryDirectory() as folder:
                    checkpoint, history = train(examples, own, seed, Path(folder) / "state.pt", hand)
                training = time.process_time() - begin
                mine = judge_samplers(checkpoint, examples, energies, settings.sampling, chosen.samples, seed)
                found = pd.DataFrame([{"objective": name, "seed": seed} | row for row in mine])
                found["training_seconds"] = training
                kept.parent.mkdir(parents=True, exist_ok=True)
                found.to_csv(kept.with_suffix(".tmp"), index=False)
                kept.with_suffix(".tmp").rename(kept)
                last = {key: round(value, 4) for key, value in history[-1].items()}
                print(
                    f"{name}, seed {seed}: {last}, judged in {time.process_time() - begin - training:.0f} s", flush=True
                )
            rows.append(pd.read_csv(kept))
    table = summary(pd.concat(rows), chosen.samples)
    names = ("scale", "seeds", "steps", "pairs", "samples", "width", "blocks", "batch")
    options = {name: getattr(chosen, name) for name in names}
    words = " ".join(f"--{name} {value}" for name, value in options.items() if value is not None)
    unseen = sum(list(examples.pairs[index]) in settings.data.held_out_pairs for index in judged)
    facts = {
        "command": f"python benchmarks/learned_objectives.py {words}",
        "data": f"{parameters.scale} scale: {int((examples.split == 'training').sum())} training grasps of "
        f"{len(examples.pairs)} pairs; judged on {len(judged)} pairs, {unseen} of them never trained",
        "commit": code,
        "time": "CPU seconds of one core; a pair's clouds are prepared once, then its samples are drawn in one call",
    }
    write_comparison(OBJECTIVES_FILE, table, facts)
    print(table.to_string(float_format=lambda value: f"{value:.3g}"))


if __name__ == "__main__":
    main()
