"""Two-object grasps from the trained model.

`python -m pipeline.sample --source learned` brings those of all pairs of params.yaml up to date, `--object cube`
draws those of the pairs that begin with one object by hand: ``data/sample/learned/<object>.parquet``, tables like those
of ``merge``, and ``quality.json``.

`--source reconstructed` draws them for objects as photos show them, the pairs under ``reconstructed`` in params.yaml.
It knows nothing else of the objects, and writes ``data/sample/reconstructed`` in the frames of the reconstructions.

`python -m pipeline.sample --object0 FILE --object1 FILE -n 25` draws them for two objects of your own, meshes or
point clouds in metres, and writes grasps.parquet, grasps.json and grasps.html.
"""

from __future__ import annotations

import argparse
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.records import paths
from pipeline.records.digests import digest, file_digest, folder_digest, hand_digest, prepared_digest
from pipeline.records.errors import UserError
from pipeline.records.hands import ALLEGRO
from pipeline.records.parameters import chosen_pairs, load_with_workers
from pipeline.records.parameters.names import require_name
from pipeline.stages.code import own_fingerprint
from pipeline.stages.items import Keep, Stage, fingerprints_of, make_by_hand, make_items, one_by_one
from pipeline.stages.outputs import TablesWithFigures
from pipeline.stages.running import command, run_stage

if TYPE_CHECKING:
    import pandas as pd

    from pipeline.compute.pool import Work
    from pipeline.hand.model import Hand
    from pipeline.model.checkpoint import Checkpoint
    from pipeline.records.objects import PreparedObject
    from pipeline.sample.proposals import Drawn


def sections(source: str = "learned") -> list[str]:
    """Return the sections of ``params.yaml`` that ``sample@<source>`` depends on."""
    synthesis = ["synthesize.energy", "synthesize.pinch", "synthesize.side"]
    pairs = ["reconstructed"] if source == paths.RECONSTRUCTED else ["styles", "pairs"]
    return ["seed", *pairs, "picks", "train.sampling", *synthesis, "merge", "physics", "validate", "robustness"]


def sample(source: str, only: str) -> None:
    """Draw grasps for the pairs of a source that are not up to date, or for those of one first object by hand.

    Raises:
        UserError: an input is missing or damaged, or params.yaml does not name the object for this source.
    """
    parameters, workers = load_with_workers(sections(source))
    seen = (
        _Reconstructions(parameters["reconstructed"], only)
        if source == paths.RECONSTRUCTED
        else _Prepared(parameters, only)
    )

    from pipeline.compute.shared import Shared
    from pipeline.hand.model import load_hand
    from pipeline.records.tables import MERGED
    from pipeline.sample.proposals import Model, sampling
    from pipeline.stages.seeds import item_seed

    hand = load_hand(ALLEGRO)
    checkpoint = _checkpoint(hand)
    output = TablesWithFigures(paths.sampled_file(source, "").parent, MERGED, ("objects",))
    stage = Stage(f"sample@{source}", "pairs", output)

    with Shared(Model(checkpoint)) as model:

        def work(key: str, keep: Keep) -> Work[None]:
            first, second = key.split("/")
            seed = item_seed(parameters["seed"], "train", seen.identity, first, second) % 2**31
            objects = seen.objects(first, second)
            points = (objects[0].surface_points, objects[1].surface_points)
            table, drawn, figures = yield from sampling(model, _request(parameters, hand, objects, points, seed))
            if source != paths.RECONSTRUCTED:
                merged = _merged(first, second)
                known = {"trained": (first, second) in checkpoint.pairs, "held_out": {}, "held_out_by_training": {}}
                figures |= known if merged is None else _against_known(checkpoint, hand, (first, second), merged, drawn)
            keep(key, (output.rows(table), figures))
            print(f"{first} then {second}, {source}: {len(_accepted(table))} accepted of {len(table)} tried")

        keys = [(first, second) for first, seconds in seen.pairs.items() for second in seconds]
        if only:
            make_by_hand(stage, ["/".join(key) for key in keys], one_by_one(work), workers)
            return
        values = [parameters[name] for name in sections(source) if name not in ("styles", "pairs", "reconstructed")]
        files = [file_digest(paths.MODEL_FOLDER / name, "train") for name in ("model.json", "model.safetensors")]
        common = digest(own_fingerprint("sample"), source, values, files, hand_digest(hand.name))
        fingerprints, refused = fingerprints_of(
            ["/".join(key) for key in keys], lambda key: digest(common, key.split("/"), seen.digest(*key.split("/")))
        )
        make_items(stage, fingerprints, one_by_one(work), workers, refused)


def _checkpoint(hand: Hand) -> Checkpoint:
    """Return the trained model.

    Raises:
        UserError: there is none, it is damaged, or it was trained for another hand.
    """
    from pipeline.model.checkpoint import read_checkpoint
    from pipeline.model.held_out import STYLES
    from pipeline.model.representation import dimensions

    checkpoint = read_checkpoint(paths.MODEL_FOLDER)
    trained, wanted = len(checkpoint.normalisation.mean), dimensions(len(STYLES), hand)
    if trained != wanted:
        raise UserError(
            f"{paths.MODEL_FOLDER} knows grasps of {trained} numbers, those of the hand {hand.name} have {wanted}; run "
            "`dvc repro train` to make it for this hand."
        )
    return checkpoint


class _Prepared:
    """Pairs of prepared objects, whose surface the model sees."""

    identity = "sample"  # what the seed of a pair depends on

    def __init__(self, parameters: dict[str, Any], only: str) -> None:
        self.pairs = chosen_pairs(parameters, only)

    def objects(self, first: str, second: str) -> tuple[PreparedObject, PreparedObject]:
        """Return the objects of a pair."""
        from pipeline.records.kept import kept_object

        return kept_object(first), kept_object(second)

    def digest(self, first: str, second: str) -> str:
        """Return the digest of what the grasps of a pair depend on."""
        from pipeline.records.flat import PAIR_GRASPS
        from pipeline.records.tables import arrow_table

        merged = _merged(first, second)
        known = None if merged is None else arrow_table(merged, PAIR_GRASPS)
        return digest(prepared_digest(first), prepared_digest(second), known)


class _Reconstructions:
    """Pairs of objects of which the model sees what photos show, and knows nothing else."""

    identity = paths.RECONSTRUCTED

    def __init__(self, chosen: dict[str, Any], only: str) -> None:
        if only:
            require_name(only, chosen, "reconstructed")
        self._captures = {first: item.capture for first, item in chosen.items()}
        self.pairs = {first: tuple(item.side) for first, item in chosen.items() if only in ("", first)}

    def objects(self, first: str, second: str) -> tuple[PreparedObject, PreparedObject]:
        """Return the objects of a pair."""
        capture = self._captures[first]
        return _reconstructed(capture, first), _reconstructed(capture, second)

    def digest(self, first: str, second: str) -> str:
        """Return the digest of what the grasps of a pair depend on."""
        folder = paths.reconstruction_folder(self._captures[first]) / "objects"
        return digest([folder_digest(folder / name, "reconstruct") for name in (first, second)])


@lru_cache(maxsize=16)
def _reconstructed(capture: str, name: str) -> PreparedObject:
    from pipeline.records.reconstructions import load_reconstructed_object
    from pipeline.shapes.solids import object_of_reconstruction

    return object_of_reconstruction(load_reconstructed_object(capture, name))


def _merged(first: str, second: str) -> pd.DataFrame | None:
    """Return the merged grasps of a pair, with a column per object; None where there is no table.

    They serve a figure of quality alone, which is left out then.
    """
    from pipeline.records.flat import PAIR_GRASPS, pair_rows
    from pipeline.records.kept import kept_table

    if not paths.merged_file(first).exists():
        return None
    return pair_rows(kept_table(paths.merged_file(first), PAIR_GRASPS, "merge"), second)


def _against_known(
    checkpoint: Checkpoint, hand: Hand, pair: tuple[str, str], merged: pd.DataFrame, drawn: Drawn
) -> dict[str, Any]:
    """Return whether the model was trained on a pair, and how near its samples come to grasps it has not seen.

    Args:
        merged: the pair's table of ``merge``.
    """
    import numpy as np

    from pipeline.model.held_out import unseen_rows
    from pipeline.model.representation import grasps_of
    from pipeline.sample.quality import nearest_samples

    known = merged[merged["rejected_by"] == ""]
    trained = pair in checkpoint.pairs
    unseen = unseen_rows(known, checkpoint.held_out) if trained else np.ones(len(known), dtype=bool)
    held_out, seen = known[unseen], known[~unseen][: len(drawn.ranked.grasps)]
    return {
        "trained": trained,
        "held_out": nearest_samples(hand, grasps_of(held_out), drawn.ranked.grasps) if len(held_out) else {},
        # What as many grasps to learn from cover: no set of that size can be expected to do much better.
        "held_out_by_training": (
            nearest_samples(hand, grasps_of(held_out), grasps_of(seen)) if len(held_out) and len(seen) else {}
        ),
    }


def _accepted(table: Any) -> Any:
    """Return the places in the ranking of the accepted rows of a table."""
    return table.loc[table["rejected_by"] == "", "merged_id"].to_numpy(dtype="int64")


def _request(parameters: dict[str, Any], hand: Hand, objects: Any, points: Any, seed: int) -> Any:
    from pipeline.pairing.task import task_of
    from pipeline.robustness.measures import measuring
    from pipeline.sample.proposals import SampleRequest

    own = measuring(parameters["robustness"], parameters["seed"], *(item.name for item in objects))
    return SampleRequest(
        pair=task_of(
            hand,
            parameters["picks"],
            objects,
            parameters["merge"],
            parameters["physics"],
            parameters["validate"],
            own,
        ),
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
    parameters, workers = load_with_workers(sections())

    from time import perf_counter

    from pipeline.energy.scene import compile_kernels
    from pipeline.hand.model import load_hand
    from pipeline.records.flat import PAIR_GRASPS, flat
    from pipeline.records.tables import MERGED, arrow_table, write_arrow
    from pipeline.records.writing import whole_file, write_json
    from pipeline.sample.own_objects import load_own_object
    from pipeline.sample.proposals import check_grasps, draw_grasps, in_frames_of_files, pair_energy
    from pipeline.sample.view import grasp_page

    (first, points0, centre0), (second, points1, centre1) = (load_own_object(source) for source in sources)
    hand = load_hand(ALLEGRO)
    checkpoint = _checkpoint(hand)
    model = checkpoint.model()
    settings = parameters["train.sampling"]
    enough = {"grasps": count, "draws": max(settings.draws, 2 * count)}
    parameters["train.sampling"] = settings.model_copy(update=enough)
    request = _request(parameters, hand, (first, second), (points0, points1), parameters["seed"])
    energy = pair_energy(request)
    compile_kernels()
    begin = perf_counter()
    drawn = draw_grasps(checkpoint, model, request, energy)
    ranked = perf_counter()
    table = check_grasps(request, drawn, workers)
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
    rows = flat(arrow_table(accepted, MERGED), PAIR_GRASPS).to_pylist()
    with whole_file(output / "grasps.html") as temporary:
        temporary.write_text(grasp_page(rows, (first, second), hand), encoding="utf-8")
    own_frames = arrow_table(in_frames_of_files(accepted, (centre0, centre1)), MERGED)
    write_arrow(output / "grasps.parquet", own_frames)
    write_json(output / "grasps.json", flat(own_frames, PAIR_GRASPS).to_pylist())
    print(f"wrote grasps.parquet, grasps.json and grasps.html to {output}")


@command("sample")
def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline.sample",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--object", default="", help="the object that is picked first, a name in params.yaml")
    parser.add_argument(
        "--source", choices=["learned", paths.RECONSTRUCTED], help="what the model sees of the objects of params.yaml"
    )
    parser.add_argument("--object0", type=Path, help="file of the object that is pinched, metres, z up")
    parser.add_argument("--object1", type=Path, help="file of the object that ring finger and palm hold")
    parser.add_argument("-n", type=int, default=25, help="grasps wanted (default: %(default)s)")
    parser.add_argument("--output", type=Path, default=Path("grasps"), help="folder to write to (default: %(default)s)")
    chosen = parser.parse_args(arguments)
    if chosen.source:
        return run_stage(f"sample@{chosen.source}", lambda: sample(chosen.source, chosen.object))
    if chosen.object:
        parser.error("give --object with --source learned or --source reconstructed")
    if not (chosen.object0 and chosen.object1) or chosen.n < 1:
        parser.error("give --source NAME, or --object0 FILE and --object1 FILE, and -n of at least 1")
    sample_own((chosen.object0, chosen.object1), chosen.n, chosen.output)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
