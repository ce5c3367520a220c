"""Two-object grasps from the trained model.

`python -m pipeline.train.sample --object cube` draws them for all pairs that begin with an object of params.yaml and
writes ``data/train/<object>``: one table per second object, like those of ``merge``, and ``quality.json``.

`python -m pipeline.train.sample --source reconstructed --object cube` draws them for objects as photos show them: all
pairs under ``reconstructed`` in params.yaml that begin with this one. It knows nothing else of the objects, and writes
``data/train_reconstructed/<object>`` in the frames of the reconstructions.

`python -m pipeline.train.sample --object0 FILE --object1 FILE -n 25` draws them for two objects of your own, meshes or
point clouds in metres, and writes grasps.parquet, grasps.json and grasps.html.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.parameters import load_parameters, read_parameters
from pipeline.records.running import run_stage

if TYPE_CHECKING:
    import pandas as pd

    from pipeline.records.objects import PreparedObject
    from pipeline.train.checkpoint import Checkpoint
    from pipeline.train.proposals import Drawn


def sections(source: str = "", object_name: str = "") -> list[str]:
    """Parameter sections of the stage ``sample@<object>``, or ``sample-reconstructed@<object>`` for that source."""
    synthesis = ["synthesize.energy", "synthesize.pinch", "synthesize.side"]
    pairs = f"reconstructed.{object_name}" if source == paths.RECONSTRUCTED else "styles"
    return ["seed", pairs, "train.sampling", *synthesis, "merge", "physics", "validate"]


def sample_pairs(first: str) -> None:
    """Draw grasps for all pairs that begin with ``first`` and write their folder, whole or not at all.

    Raises:
        UserError: an input is missing or damaged, or ``styles.pinch`` does not name the object.
    """
    parameters = load_parameters(sections())
    second_objects = parameters["styles"].after(first)

    from pipeline.records.objects import load_prepared_object
    from pipeline.records.tables import MERGED, read_table

    stage = _Stage(parameters)
    objects = {name: load_prepared_object(name) for name in dict.fromkeys([first, *second_objects])}
    tables, figures = {}, {}
    for second in second_objects:
        seed = ("train", "sample", first, second)
        tables[second], drawn, common = stage.draw((objects[first], objects[second]), seed)
        merged = read_table(paths.merged_file(first, second), MERGED, f"merge@{first}")
        figures[second] = common | _against_known(stage.checkpoint, (first, second), merged, drawn)
        print(f"{first} then {second}: {len(_accepted(tables[second]))} accepted of {len(tables[second])} tried")
    _write_folder(paths.sampled_folder(first), tables, figures)


def sample_reconstructed(first: str) -> None:
    """Draw grasps for all pairs of reconstructed objects that begin with ``first`` and write their folder.

    Raises:
        UserError: an input is missing or damaged, or ``reconstructed`` does not name the object.
    """
    parameters = load_parameters(sections(paths.RECONSTRUCTED, first))
    pairs = parameters[f"reconstructed.{first}"]

    from pipeline.records.reconstructions import load_reconstructed_object
    from pipeline.records.solids import object_of_reconstruction

    stage = _Stage(parameters)
    objects = {
        name: object_of_reconstruction(load_reconstructed_object(pairs.capture, name))
        for name in dict.fromkeys([first, *pairs.side])
    }
    tables, figures = {}, {}
    for second in pairs.side:
        seed = ("train", paths.RECONSTRUCTED, first, second)
        tables[second], _, figures[second] = stage.draw((objects[first], objects[second]), seed)
        accepted = len(_accepted(tables[second]))
        print(f"{first} then {second}, reconstructed: {accepted} accepted of {len(tables[second])} tried")
    _write_folder(paths.reconstructed_folder(first), tables, figures)


class _Stage:
    """The trained model, and what both stages do with a pair."""

    def __init__(self, parameters: dict[str, Any]) -> None:
        from pipeline.train.checkpoint import read_checkpoint

        self.parameters = parameters
        self.workers = read_parameters().compute
        self.checkpoint = read_checkpoint(paths.MODEL_FOLDER)
        self.model = self.checkpoint.model()

    def draw(
        self, pair: tuple[PreparedObject, PreparedObject], identity: tuple[str, ...]
    ) -> tuple[pd.DataFrame, Drawn, dict[str, Any]]:
        """Return the table of checked grasps of a pair, what was drawn, and figures for ``quality.json``.

        Args:
            identity: what the random seed of the pair depends on, besides the run's.
        """
        from pipeline.records.seeds import item_seed
        from pipeline.train.proposals import check_grasps, draw_grasps, pair_energy, quality

        points = (pair[0].surface_points, pair[1].surface_points)
        task = _task(self.parameters, pair, points, item_seed(self.parameters["seed"], *identity) % 2**31)
        energy = pair_energy(task)
        drawn = draw_grasps(self.checkpoint, self.model, task, energy)
        table = check_grasps(task, drawn, self.workers)
        figures = {
            "drawn": len(drawn.ranked.grasps),
            "joint_violation_mean": float(drawn.joint_violation.mean()),
            "raw": quality(energy, drawn.raw),
            "ranked": quality(energy, drawn.ranked.chosen(_accepted(table))),
        }
        return table, drawn, figures


def _against_known(checkpoint: Checkpoint, pair: tuple[str, str], merged: pd.DataFrame, drawn: Drawn) -> dict[str, Any]:
    """Return whether the model was trained on a pair, and how near its samples come to grasps it has not seen.

    Args:
        merged: the pair's table of ``merge``.
    """
    import numpy as np

    from pipeline.train.data import grasps_of, unseen_rows
    from pipeline.train.quality import nearest_samples

    known = merged[merged["rejected_by"] == ""]
    trained = pair in checkpoint.pairs
    unseen = unseen_rows(known, checkpoint.held_out) if trained else np.ones(len(known), dtype=bool)
    held_out, seen = known[unseen], known[~unseen][: len(drawn.ranked.grasps)]
    return {
        "trained": trained,
        "held_out": nearest_samples(grasps_of(held_out), drawn.ranked.grasps) if len(held_out) else {},
        # What as many grasps to learn from cover: no set of that size can be expected to do much better.
        "held_out_by_training": (
            nearest_samples(grasps_of(held_out), grasps_of(seen)) if len(held_out) and len(seen) else {}
        ),
    }


def _write_folder(target: Path, tables: dict[str, pd.DataFrame], figures: dict[str, dict[str, Any]]) -> None:
    """Write one table per second object, and the figures, as a whole folder."""
    from pipeline.records.tables import MERGED, write_table
    from pipeline.records.writing import whole_folder, write_json

    with whole_folder(target) as folder:
        for second, table in tables.items():
            write_table(folder / f"{second}.parquet", table, MERGED)
        write_json(folder / "quality.json", figures)


def _accepted(table: Any) -> Any:
    """Return the places in the ranking of the accepted rows of a table."""
    return table.loc[table["rejected_by"] == "", "merged_id"].to_numpy(dtype="int64")


def _task(parameters: dict[str, Any], objects: Any, points: Any, seed: int) -> Any:
    from pipeline.pairing.combination import Pair
    from pipeline.train.proposals import Task

    return Task(
        pair=Pair(objects[0], objects[1], parameters["merge"], parameters["physics"], parameters["validate"]),
        points=points,
        settings=parameters["train.sampling"],
        energy=parameters["synthesize.energy"],
        styles=(parameters["synthesize.pinch"], parameters["synthesize.side"]),
        seed=seed,
    )


def sample_own(sources: tuple[Path, Path], count: int, output: Path) -> None:
    """Draw ``count`` grasps of two objects of the user's own and write them, ranked, in the frames of their files.

    Raises:
        UserError: a file cannot be used, or there is no trained model.
    """
    parameters = load_parameters(sections())
    workers = read_parameters().compute

    from time import perf_counter

    from pipeline.records.tables import MERGED, write_table
    from pipeline.records.writing import whole_file, write_json
    from pipeline.train.checkpoint import read_checkpoint
    from pipeline.train.own_objects import load_own_object
    from pipeline.train.proposals import check_grasps, draw_grasps, in_frames_of_files, pair_energy
    from pipeline.train.view import grasp_page

    (first, points0, centre0), (second, points1, centre1) = (load_own_object(source) for source in sources)
    checkpoint = read_checkpoint(paths.MODEL_FOLDER)
    model = checkpoint.model()
    settings = parameters["train.sampling"]
    enough = {"grasps": count, "draws": max(settings.draws, 2 * count)}
    parameters["train.sampling"] = settings.model_copy(update=enough)
    task = _task(parameters, (first, second), (points0, points1), parameters["seed"])
    energy = pair_energy(task)
    energy.compile()
    begin = perf_counter()
    drawn = draw_grasps(checkpoint, model, task, energy)
    ranked = perf_counter()
    table = check_grasps(task, drawn, workers)
    accepted = table[table["rejected_by"] == ""]
    print(
        f"{enough['draws']} samples drawn and ranked in {ranked - begin:.1f} s; {len(accepted)} accepted of "
        f"{len(table)} checked in {perf_counter() - ranked:.1f} s"
    )
    if accepted.empty:
        raise UserError(
            f"none of {len(table)} samples passed the checks (first: {table['rejected_by'].iloc[0]}); try a larger -n, "
            "or `train.sampling.check: false` in params.yaml to see them all the same."
        )
    rows = accepted.to_dict("records")
    with whole_file(output / "grasps.html") as temporary:
        temporary.write_text(grasp_page(rows, (first, second)), encoding="utf-8")
    own_frames = in_frames_of_files(accepted, centre0, centre1)
    write_table(output / "grasps.parquet", own_frames, MERGED)
    own = [{name: plain(value) for name, value in row.items()} for row in own_frames.to_dict("records")]
    write_json(output / "grasps.json", own)
    print(f"wrote grasps.parquet, grasps.json and grasps.html to {output}")


def plain(value: Any) -> Any:
    """Return a cell of a table as JSON knows it."""
    return value.tolist() if hasattr(value, "tolist") else value


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline.train.sample",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--object", help="the object that is picked first, a name in params.yaml")
    parser.add_argument(
        "--source", choices=[paths.RECONSTRUCTED], help="with --object: see the objects as photos show them"
    )
    parser.add_argument("--object0", type=Path, help="file of the object that is pinched, metres, z up")
    parser.add_argument("--object1", type=Path, help="file of the object that ring finger and palm hold")
    parser.add_argument("-n", type=int, default=25, help="grasps wanted (default: %(default)s)")
    parser.add_argument("--output", type=Path, default=Path("grasps"), help="folder to write to (default: %(default)s)")
    chosen = parser.parse_args(arguments)
    if chosen.object and chosen.source == paths.RECONSTRUCTED:
        return run_stage(f"sample-reconstructed@{chosen.object}", lambda: sample_reconstructed(chosen.object))
    if chosen.object:
        return run_stage(f"sample@{chosen.object}", lambda: sample_pairs(chosen.object))
    if chosen.source:
        parser.error("give --source with --object NAME")
    if not (chosen.object0 and chosen.object1) or chosen.n < 1:
        parser.error("give --object NAME, or --object0 FILE and --object1 FILE, and -n of at least 1")
    try:
        sample_own((chosen.object0, chosen.object1), chosen.n, chosen.output)
    except UserError as error:
        print(f"sample: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
