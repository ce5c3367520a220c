"""Two-object grasps from the trained model.

`python -m pipeline.train.sample --object cube` draws them for all pairs that begin with an object of params.yaml and
writes ``data/train/<object>``: one table per second object, like those of ``merge``, and ``quality.json``.

`python -m pipeline.train.sample --object0 FILE --object1 FILE -n 25` draws them for two objects of your own, meshes or
point clouds in metres, and writes grasps.parquet, grasps.json and grasps.html.
"""

from __future__ import annotations

import argparse
from typing import Any

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.parameters import load_parameters, read_parameters
from pipeline.records.running import run_stage

DEFAULT_OUTPUT = "grasps"


def sections() -> list[str]:
    """Parameter sections that the stage ``sample@<object>`` depends on."""
    synthesis = ["synthesize.energy", "synthesize.pinch", "synthesize.side"]
    return ["seed", "styles", "train.sampling", *synthesis, "merge", "physics", "validate"]


def sample_pairs(first: str) -> None:
    """Draw grasps for all pairs that begin with ``first`` and write their folder, whole or not at all.

    Raises:
        UserError: an input is missing or damaged, or ``styles.pinch`` does not name the object.
    """
    parameters = load_parameters(sections())
    workers = read_parameters().compute.workers
    styles, seed = parameters["styles"], parameters["seed"]
    if first not in styles.pinch:
        raise UserError(
            f"params.yaml: styles.pinch does not name {first!r}; add it there, or use one of {', '.join(styles.pinch)}."
        )

    from pipeline.records.objects import load_prepared_object
    from pipeline.records.seeds import item_seed
    from pipeline.records.tables import MERGED, read_table, write_table
    from pipeline.records.writing import whole_folder, write_json
    from pipeline.train.checkpoint import read_checkpoint
    from pipeline.train.data import grasps_of, unseen_rows
    from pipeline.train.proposals import check_grasps, draw_grasps, pair_energy, quality
    from pipeline.train.quality import nearest_samples

    checkpoint = read_checkpoint(paths.MODEL_FOLDER)
    model = checkpoint.model()
    objects = {name: load_prepared_object(name) for name in dict.fromkeys([first, *styles.side])}
    tables, figures = {}, {}
    for second in styles.side:
        pair = (objects[first], objects[second])
        points = (pair[0].surface_points, pair[1].surface_points)
        task = _task(parameters, pair, points, item_seed(seed, "train", "sample", first, second) % 2**31)
        energy = pair_energy(task)
        drawn = draw_grasps(checkpoint, model, task, energy)
        table = tables[second] = check_grasps(task, drawn, workers)
        merged = read_table(paths.merged_file(first, second), MERGED, f"merge@{first}")
        known = merged[merged["rejected_by"] == ""]
        trained = (first, second) in checkpoint.pairs
        held_out = known[unseen_rows(known, checkpoint.held_out)] if trained else known
        figures[second] = {
            "trained": trained,
            "drawn": len(drawn.ranked.grasps),
            "joint_violation_mean": float(drawn.joint_violation.mean()),
            "raw": quality(energy, drawn.raw),
            "ranked": quality(energy, drawn.ranked.chosen(_accepted(table))),
            "held_out": nearest_samples(grasps_of(held_out), drawn.ranked.grasps) if len(held_out) else {},
        }
        print(f"{first} then {second}: {len(_accepted(table))} accepted of {len(table)} tried")
    with whole_folder(paths.sampled_folder(first)) as folder:
        for second, table in tables.items():
            write_table(folder / paths.sampled_file(first, second).name, table, MERGED)
        write_json(folder / "quality.json", figures)


def _accepted(table: Any) -> Any:
    """Return the places in the ranking of the accepted rows of a table."""
    return table.loc[table["rejected_by"] == "", "merged_id"].to_numpy(dtype="int64")


def _task(parameters: dict[str, Any], objects: Any, points: Any, seed: int) -> Any:
    from pipeline.pairing.combination import Pair
    from pipeline.train.proposals import Task

    return Task(
        pair=Pair(*objects, parameters["merge"], parameters["physics"], parameters["validate"]),
        points=points,
        settings=parameters["train.sampling"],
        energy=parameters["synthesize.energy"],
        styles=(parameters["synthesize.pinch"], parameters["synthesize.side"]),
        seed=seed,
    )


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline.train.sample",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--object", help="the object that is picked first, a name in params.yaml")
    chosen = parser.parse_args(arguments)
    return run_stage(f"sample@{chosen.object}", lambda: sample_pairs(chosen.object))


if __name__ == "__main__":
    raise SystemExit(main())
