"""Learn two-object grasps from the merged ones: `python -m pipeline.train` writes ``models/train``."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.records import paths
from pipeline.records.digests import digest, hand_digest
from pipeline.records.parameters import chosen_sequences, load_parameters, second_objects
from pipeline.records.parameters.train import TrainingParameters
from pipeline.stages.code import own_fingerprint
from pipeline.stages.items import Keep, Stage, all_wanted, make_items
from pipeline.stages.outputs import Folders, files_in
from pipeline.stages.running import run_stage

if TYPE_CHECKING:
    from pipeline.compute.pool import Work

STAGE = Stage("train", "models", Folders(paths.MODEL_FOLDER))


def sections() -> list[str]:
    """Return the sections of ``params.yaml`` that the stage depends on."""
    parts = ["data", "encoder", "denoiser", "diffusion", "optimization"]
    return ["hand", "seed", "styles", "pairs", "picks", *(f"train.{part}" for part in parts)]


def train_model() -> None:
    """Train on the accepted grasps of all pairs; a run that was killed goes on where it last recorded its losses.

    The model stays what it is when nothing has changed that it learns from.

    Raises:
        UserError: a table or object is missing or damaged, or there is nothing to learn from.
    """
    parameters = load_parameters(sections())
    seed, data = parameters["seed"], parameters["train.data"]

    from pipeline.hand.model import load_hand
    from pipeline.model.checkpoint import write_checkpoint
    from pipeline.records.flat import PAIR_GRASPS, pair_rows, read_flat
    from pipeline.records.objects import load_prepared_object
    from pipeline.records.tables import of_hand
    from pipeline.train.data import gather_examples, held_out_objects
    from pipeline.train.training import train, training_identity

    hand = load_hand(parameters["hand"])
    tables: dict[tuple[str, str], Any] = {}
    pairs = second_objects(chosen_sequences(parameters))
    unseen = held_out_objects({name for first, own in pairs.items() for name in (first, *own)}, data, seed)
    for first, seconds in pairs.items():
        learned = [second for second in seconds if second not in unseen]
        if first in unseen or not learned:
            continue
        merged = read_flat(paths.merged_file(first), of_hand(PAIR_GRASPS, hand.name, hand.joint_count), "merge")
        tables |= {(first, second): pair_rows(merged, second) for second in learned}
    objects = {name: load_prepared_object(name) for name in dict.fromkeys(name for pair in tables for name in pair)}
    settings = {name.partition(".")[2]: value for name, value in parameters.items() if name.startswith("train.")}
    training = TrainingParameters(**settings)
    examples = gather_examples(tables, objects, data, settings["encoder"], seed)
    code = digest(own_fingerprint("train"), hand_digest(hand.name))

    if all_wanted():
        paths.TRAINING_STATE.unlink(missing_ok=True)

    def work(keep: Keep) -> Work[None]:
        from tempfile import TemporaryDirectory

        checkpoint, history = train(examples, training, seed, paths.TRAINING_STATE, hand, code)
        with TemporaryDirectory() as temporary:
            write_checkpoint(Path(temporary) / "model", checkpoint, history)
            keep("", files_in(Path(temporary) / "model"))
        paths.TRAINING_STATE.unlink(missing_ok=True)
        last = history[-1]
        losses = ", ".join(f"{name.replace('_', ' ')} {last[name]:.4f}" for name in last if name.endswith("_loss"))
        count = int((examples.split == "training").sum())
        print(f"trained on {count} grasps of {len(checkpoint.pairs)} pairs: {losses}")
        yield from ()

    def begin(keys: Sequence[str], keep: Keep) -> list[tuple[str, Any]]:
        return [("model", lambda: work(keep))]

    make_items(STAGE, {"": training_identity(examples, training, seed, code)}, begin, workers=1)


def main() -> int:
    """Run the command."""
    argparse.ArgumentParser(prog="python -m pipeline.train", description=__doc__).parse_args()
    return run_stage("train", train_model)


if __name__ == "__main__":
    raise SystemExit(main())
