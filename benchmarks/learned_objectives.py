"""Which objective and sampler give the best grasps per CPU second: trains every objective with several seeds.

Reads ``data/prepare`` and ``data/merge`` of the composed parameters; writes ``reports/learned_objectives.md`` and
prints it. Samples are judged as drawn: nothing is refined, ranked or checked. A minute of one core per training at demo
scale.

    python benchmarks/learned_objectives.py --seeds 3 --steps 1500
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402

import pipeline  # noqa: E402, F401  (sets the thread counts before numpy is imported)
from pipeline.hand.allegro import load_hand  # noqa: E402
from pipeline.records import paths  # noqa: E402
from pipeline.records.objects import load_prepared_object  # noqa: E402
from pipeline.records.parameters import read_parameters  # noqa: E402
from pipeline.records.parameters.train import DiffusionParameters, TrainingParameters  # noqa: E402
from pipeline.records.tables import MERGED, read_table  # noqa: E402
from pipeline.train.data import gather_examples  # noqa: E402
from pipeline.train.quality import grasp_distances, nearest_samples, penetration_depth  # noqa: E402
from pipeline.train.refinement import PairEnergy, refine  # noqa: E402
from pipeline.train.sampling import sample_grasps  # noqa: E402
from pipeline.train.training import train  # noqa: E402

OBJECTIVES = [("clean", "cosine"), ("flow", "cosine"), ("epsilon", "cosine"), ("epsilon", "published")]
SAMPLERS = [("ddim", 10), ("ddim", 20), ("dpm", 20), ("ancestral", 20), ("ancestral", 50), ("ancestral", 100)]
USABLE_DEPTH, USABLE_CONTACT = 0.001, 0.002  # m


def judge(energy: PairEnergy, grasps, known, held_out) -> dict[str, float]:
    """Return figures of one pair's samples."""
    hand = load_hand()
    scored = refine(energy, grasps, 0, 0.001, np.random.default_rng(0))
    depth = np.maximum(
        *[
            penetration_depth(hand, item, energy.fields[slot], grasps.T_hand_object[:, slot], grasps.q)
            for slot, item in enumerate(energy.objects)
        ]
    )
    contact = np.mean([own.distance for own in scored.contacts], axis=0)
    usable = (depth <= USABLE_DEPTH) & (contact <= USABLE_CONTACT) & (scored.overlap == 0)
    among = grasp_distances(hand, grasps, grasps)
    nearest = grasp_distances(hand, grasps, known).min(1)
    return {
        "usable": float(usable.mean()),
        "energy": float(np.median(scored.energy)),
        "overlap mm": 1000 * float(np.median(depth)),
        "contact mm": 1000 * float(np.median(contact)),
        "spread mm": 1000 * float(np.median(among[np.triu_indices(len(among), 1)])),
        "to training mm": 1000 * float(np.median(nearest)),
        "to held out mm": nearest_samples(held_out, grasps)["nearest_mm_median"] if len(held_out) else float("nan"),
    }


def main() -> None:
    """Train, sample, judge, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--steps", type=int, default=1500)
    parser.add_argument("--samples", type=int, default=64, help="per pair")
    chosen = parser.parse_args()
    parameters = read_parameters()
    styles, settings = parameters.styles, parameters.train
    objects = {name: load_prepared_object(name) for name in dict.fromkeys([*styles.pinch, *styles.side])}
    tables = {
        (first, second): read_table(paths.merged_file(first, second), MERGED, f"merge@{first}")
        for first in styles.pinch
        for second in styles.side
    }
    examples = gather_examples(tables, objects, settings.data, settings.encoder, parameters.seed)
    energies = [
        PairEnergy(
            (objects[first], objects[second]),
            parameters.synthesize.energy,
            (parameters.synthesize.pinch, parameters.synthesize.side),
            parameters.merge.clearance,
        )
        for first, second in examples.pairs
    ]
    rows = []
    for objective, schedule in OBJECTIVES:
        own = TrainingParameters(
            data=settings.data,
            encoder=settings.encoder,
            denoiser=settings.denoiser,
            diffusion=DiffusionParameters(objective=objective, schedule=schedule),
            optimization=settings.optimization.model_copy(
                update={"steps": chosen.steps, "record_every": max(chosen.steps // 10, 1)}
            ),
        )
        for seed in range(1, chosen.seeds + 1):
            begin = time.process_time()
            with tempfile.TemporaryDirectory() as folder:
                checkpoint, _ = train(examples, own, seed, Path(folder) / "state.pt")
            training = time.process_time() - begin
            model = checkpoint.model()
            for sampler, steps in SAMPLERS:
                for index, energy in enumerate(energies):
                    mine = examples.pair == index
                    points = tuple(item.surface_points for item in energy.objects)
                    begin = time.process_time()
                    grasps, _ = sample_grasps(checkpoint, model, points, chosen.samples, sampler, steps, seed)
                    sampling = time.process_time() - begin
                    known, held_out = (examples.grasps[mine & (examples.split == s)] for s in ("training", "held_out"))
                    name = objective if schedule == "cosine" else f"{objective} ({schedule} schedule)"
                    rows.append(
                        {"objective": name, "sampler": f"{sampler} {steps}", "seed": seed}
                        | judge(energy, grasps, known, held_out)
                        | {"training s": training, "sampling s": sampling}
                    )
                print(pd.DataFrame(rows[-len(energies) :]).mean(numeric_only=True).round(3).to_dict(), flush=True)
    table = pd.DataFrame(rows)
    by_seed = table.groupby(["objective", "sampler", "seed"], sort=False).mean(numeric_only=True)
    means = by_seed.groupby(["objective", "sampler"], sort=False).mean()
    means.insert(1, "usable, least and most", [
        f"{100 * group.min():.0f}-{100 * group.max():.0f} %"
        for _, group in by_seed["usable"].groupby(["objective", "sampler"], sort=False)
    ])  # fmt: skip
    lines = [
        "# Objectives and samplers",
        "",
        f"`python benchmarks/learned_objectives.py --seeds {chosen.seeds} --steps {chosen.steps}`: "
        f"{len(examples.pairs)} pairs, {int((examples.split == 'training').sum())} training grasps, "
        f"{chosen.samples} samples per pair and seed, as drawn.",
        "Usable: hand and objects overlap at most 1 mm, contacts at most 2 mm off on average, objects apart. Medians",
        "over samples, then means over pairs and seeds; CPU seconds of one core. Spread: between samples of a pair.",
        "",
        "| objective | sampler | " + " | ".join(means.columns) + " |",
        "|" + "---|" * (2 + len(means.columns)),
    ]
    for (objective, sampler), row in means.iterrows():
        cells = [f"{100 * row.iloc[0]:.0f} %", *(v if isinstance(v, str) else f"{v:.3g}" for v in row.iloc[1:])]
        lines.append(f"| {objective} | {sampler} | " + " | ".join(cells) + " |")
    text = "\n".join(lines) + "\n"
    Path("reports/learned_objectives.md").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
