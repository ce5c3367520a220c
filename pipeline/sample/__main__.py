"""Two-object grasps from the trained model.

`python -m pipeline.sample --source learned` brings those of all pairs of params.yaml up to date, `--object cube`
draws those of the pairs that begin with one object by hand: ``data/sample/learned/<object>.parquet``, tables like those
of ``merge``, and ``quality.json``.

`--source reconstructed` draws them for objects as photos show them, the pairs under ``reconstructed`` in params.yaml.
It knows nothing else of the objects, and writes ``data/sample/reconstructed`` in the frames of the reconstructions.

A model that was trained with `train.data.view: single` sees each object, or its reconstruction, from one camera, and so
do refinement, ranking and checks: they are given the solid that is completed from that view.
"""

from __future__ import annotations

import argparse
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

from pipeline.records import paths
from pipeline.records.digests import digest, file_digest, folder_digest, hand_digest, prepared_digest
from pipeline.records.parameters import load_with_workers, second_objects, tried_sequences
from pipeline.records.parameters.names import require_name
from pipeline.stages.code import own_fingerprint
from pipeline.stages.items import Keep, Stage, fingerprints_of, make_by_hand, make_items, one_by_one
from pipeline.stages.outputs import TablesWithFigures
from pipeline.stages.running import run_stage

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

    from pipeline.compute.pool import Work
    from pipeline.hand.model import Hand
    from pipeline.model.checkpoint import Checkpoint
    from pipeline.records.objects import PreparedObject
    from pipeline.sample.proposals import Drawn


def sections(source: str = "learned") -> list[str]:
    """Return the sections of ``params.yaml`` that ``sample@<source>`` depends on."""
    synthesis = ["synthesize.energy", "synthesize.pinch", "synthesize.side"]
    pairs = ["reconstructed"] if source == paths.RECONSTRUCTED else ["styles", "pairs"]
    return ["hand", "seed", *pairs, "picks", "train.sampling", *synthesis, "merge", "physics", "validate", "robustness"]


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

    from pipeline.compute.pool import Calls
    from pipeline.compute.shared import Shared
    from pipeline.hand.model import load_hand
    from pipeline.records.kept import without_grid
    from pipeline.records.tables import MERGED, of_hand
    from pipeline.sample.believed import believed, drawn_in_frames, table_in_frames
    from pipeline.sample.proposals import Model, request_of, sampling, trained_for
    from pipeline.stages.seeds import item_seed

    hand = load_hand(parameters["hand"])
    checkpoint = trained_for(hand)
    schema = of_hand(MERGED, hand.name, hand.joint_count)
    output = TablesWithFigures(paths.sampled_file(source, "").parent, schema, ("objects",))
    stage = Stage(f"sample@{source}", "pairs", output)

    with Shared(Model(checkpoint)) as model:

        def work(key: str, keep: Keep) -> Work[None]:
            first, second = key.split("/")
            seed = item_seed(parameters["seed"], "train", seen.identity, first, second) % 2**31
            objects = seen.objects(first, second)
            points = (objects[0].surface_points, objects[1].surface_points)
            frames = None
            if checkpoint.view == "single":
                calls = [(slot, without_grid(item)) for slot, item in enumerate(objects)]
                (objects, points, frames) = zip(*(yield Calls(partial(believed, seed), calls, 0.0, 0.05)), strict=True)
            table, drawn, figures = yield from sampling(model, request_of(parameters, hand, objects, points, seed))
            if frames is not None:
                table, drawn = table_in_frames(table, frames), drawn_in_frames(drawn, frames)
                figures["view"] = checkpoint.view
            if source != paths.RECONSTRUCTED:
                merged = _merged(hand, first, second)
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
            ["/".join(key) for key in keys],
            lambda key: digest(common, key.split("/"), seen.digest(hand, *key.split("/"))),
        )
        make_items(stage, fingerprints, one_by_one(work), workers, refused)


class _Prepared:
    """Pairs of prepared objects, whose surface the model sees."""

    identity = "sample"  # what the seed of a pair depends on

    def __init__(self, parameters: dict[str, Any], only: str) -> None:
        self.pairs = second_objects(tried_sequences(parameters, only))

    def objects(self, first: str, second: str) -> tuple[PreparedObject, PreparedObject]:
        """Return the objects of a pair."""
        from pipeline.records.kept import kept_object

        return kept_object(first), kept_object(second)

    def digest(self, hand: Hand, first: str, second: str) -> str:
        """Return the digest of what the grasps of a pair depend on."""
        from pipeline.records.tables import arrow_table

        merged = _merged(hand, first, second)
        known = None if merged is None else arrow_table(merged, _pair_grasps(hand))
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

    def digest(self, hand: Hand, first: str, second: str) -> str:
        """Return the digest of what the grasps of a pair depend on, but for the hand."""
        folder = paths.reconstruction_folder(self._captures[first]) / "objects"
        return digest([folder_digest(folder / name, "reconstruct") for name in (first, second)])


@lru_cache(maxsize=16)
def _reconstructed(capture: str, name: str) -> PreparedObject:
    from pipeline.records.reconstructions import load_reconstructed_object
    from pipeline.shapes.solids import object_of_reconstruction

    return object_of_reconstruction(load_reconstructed_object(capture, name))


def _pair_grasps(hand: Hand) -> pa.Schema:
    from pipeline.records.flat import PAIR_GRASPS
    from pipeline.records.tables import of_hand

    return of_hand(PAIR_GRASPS, hand.name, hand.joint_count)


def _merged(hand: Hand, first: str, second: str) -> pd.DataFrame | None:
    """Return the merged grasps of a pair, with a column per object; None where there is no table.

    They serve a figure of quality alone, which is left out then.
    """
    from pipeline.records.flat import pair_rows
    from pipeline.records.kept import kept_table

    if not paths.merged_file(first).exists():
        return None
    return pair_rows(kept_table(paths.merged_file(first), _pair_grasps(hand), "merge"), second)


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


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline.sample",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--object", default="", help="the object that is picked first, a name in params.yaml")
    parser.add_argument(
        "--source",
        required=True,
        choices=["learned", paths.RECONSTRUCTED],
        help="what the model sees of the objects of params.yaml",
    )
    chosen = parser.parse_args(arguments)
    return run_stage(f"sample@{chosen.source}", lambda: sample(chosen.source, chosen.object))


if __name__ == "__main__":
    raise SystemExit(main())
