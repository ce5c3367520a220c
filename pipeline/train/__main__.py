"""`python -m pipeline.train`: learn two-object grasps from the merged ones; writes ``models/train``."""

from __future__ import annotations

import argparse

from pipeline.records import paths
from pipeline.records.parameters import load_parameters
from pipeline.records.parameters.train import TrainingParameters
from pipeline.records.running import run_stage


def sections() -> list[str]:
    """Parameter sections that the stage depends on."""
    parts = ["data", "encoder", "denoiser", "diffusion", "optimization"]
    return ["seed", "styles", *(f"train.{part}" for part in parts)]


def train_model() -> None:
    """Train on the accepted grasps of all pairs; a run that was killed goes on where it last recorded its losses.

    Raises:
        UserError: a table or object is missing or damaged, or there is nothing to learn from.
    """
    parameters = load_parameters(sections())
    styles, seed = parameters["styles"], parameters["seed"]

    from pipeline.records.objects import load_prepared_object
    from pipeline.records.tables import MERGED, read_table
    from pipeline.train.checkpoint import write_checkpoint
    from pipeline.train.data import gather_examples
    from pipeline.train.training import train

    objects = {name: load_prepared_object(name) for name in dict.fromkeys([*styles.pinch, *styles.side])}
    tables = {
        (first, second): read_table(paths.merged_file(first, second), MERGED, f"merge@{first}")
        for first in styles.pinch
        for second in styles.side
    }
    settings = {name.partition(".")[2]: value for name, value in parameters.items() if name.startswith("train.")}
    examples = gather_examples(tables, objects, settings["data"], settings["encoder"], seed)
    checkpoint, history = train(examples, TrainingParameters(**settings), seed, paths.TRAINING_STATE)
    write_checkpoint(paths.MODEL_FOLDER, checkpoint, history)
    paths.TRAINING_STATE.unlink(missing_ok=True)
    last = history[-1]
    losses = ", ".join(f"{name.replace('_', ' ')} {last[name]:.4f}" for name in last if name.endswith("_loss"))
    print(f"trained on {int((examples.split == 'training').sum())} grasps of {len(checkpoint.pairs)} pairs: {losses}")


def main() -> int:
    """Run the command."""
    argparse.ArgumentParser(prog="python -m pipeline.train", description=__doc__).parse_args()
    return run_stage("train", train_model)


if __name__ == "__main__":
    raise SystemExit(main())
