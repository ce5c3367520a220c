"""A trained model on disk: weights as safetensors, everything else that sampling needs as JSON.

Layout of ``models/train/``::

    model.safetensors   averaged weights, float32
    model.json          architecture, process, normalisation, objects and pairs that it was trained on
    history.csv         losses per recorded step
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import torch
from pydantic import TypeAdapter
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from pipeline.model.network import GraspModel
from pipeline.model.representation import Normalisation
from pipeline.records.errors import UserError
from pipeline.records.hands import ALLEGRO
from pipeline.records.parameters.train import DenoiserParameters, DiffusionParameters, EncoderParameters, View
from pipeline.records.texts import parse_json
from pipeline.records.writing import whole_folder, write_json

if TYPE_CHECKING:
    from torch import Tensor


FORMAT = 1  # raised when older checkpoints can no longer be read


@dataclass(frozen=True)
class Checkpoint:
    """A trained model; ``weights`` are those of :class:`pipeline.model.network.GraspModel`."""

    hand: str  # whose grasps it knows
    encoder: EncoderParameters
    denoiser: DenoiserParameters
    diffusion: DiffusionParameters
    normalisation: Normalisation
    pairs: tuple[tuple[str, str], ...]  # trained together
    held_out: dict[str, list[int]]  # "pinch.cube" -> single grasps that no training example has a part in
    weights: dict[str, Tensor]
    view: View = "whole"  # what it sees of objects, as train.data.view

    def model(self, device: str = "cpu") -> GraspModel:
        """Return the network, ready to predict."""
        model = GraspModel(self.encoder, self.denoiser, len(self.normalisation.mean))
        model.load_state_dict(self.weights)
        return model.to(device).eval().requires_grad_(False)


def write_checkpoint(folder: Path, checkpoint: Checkpoint, history: list[dict[str, float]]) -> None:
    """Write a checkpoint and the losses on the way to it, whole or not at all.

    Raises:
        UserError: the folder cannot be written to.
    """
    config: dict[str, Any] = {
        "format": FORMAT,
        "hand": checkpoint.hand,
        "encoder": checkpoint.encoder.model_dump(),
        "denoiser": checkpoint.denoiser.model_dump(),
        "diffusion": checkpoint.diffusion.model_dump(),
        "normalisation": {
            "mean": checkpoint.normalisation.mean.tolist(),
            "deviation": checkpoint.normalisation.deviation.tolist(),
        },
        "held_out": checkpoint.held_out,
        "pairs": [list(pair) for pair in checkpoint.pairs],
    }
    if checkpoint.view != "whole":  # what a model without the entry sees
        config["view"] = checkpoint.view
    with whole_folder(folder) as temporary:
        save_file(
            {name: value.contiguous() for name, value in checkpoint.weights.items()}, temporary / "model.safetensors"
        )
        write_json(temporary / "model.json", config)
        pd.DataFrame(history).to_csv(temporary / "history.csv", index=False, float_format="%.8g")


def _check(checkpoint: Checkpoint) -> None:
    """Check that the weights are those of the network described, before room is made for it, and that all is finite.

    Raises:
        ValueError: they are not.
    """
    with torch.device("meta"):
        dimensions = len(checkpoint.normalisation.mean)
        wanted = GraspModel(checkpoint.encoder, checkpoint.denoiser, dimensions).state_dict()
    if {name: value.shape for name, value in wanted.items()} != {
        name: value.shape for name, value in checkpoint.weights.items()
    }:
        raise ValueError("its weights are not those of the network that it describes")
    numbers = [checkpoint.normalisation.mean, checkpoint.normalisation.deviation]
    if not all(np.isfinite(array).all() for array in numbers):
        raise ValueError("its normalisation is not finite")
    if not all(bool(torch.isfinite(value).all()) for value in checkpoint.weights.values()):
        raise ValueError("its weights are not finite")
    checkpoint.model()


def read_checkpoint(folder: Path) -> Checkpoint:
    """Read what :func:`write_checkpoint` wrote.

    Raises:
        UserError: the folder is missing, damaged, or of another format.
    """
    mend = "run `dvc repro train` to make it again"
    try:
        config = parse_json((folder / "model.json").read_text())
        if config["format"] != FORMAT:
            raise UserError(f"{folder} was written by another version (format {config['format']}); {mend}.")
        checkpoint = Checkpoint(
            hand=str(config.get("hand", ALLEGRO)),
            encoder=EncoderParameters.model_validate(config["encoder"]),
            denoiser=DenoiserParameters.model_validate(config["denoiser"]),
            diffusion=DiffusionParameters.model_validate(config["diffusion"]),
            normalisation=Normalisation(
                np.array(config["normalisation"]["mean"]), np.array(config["normalisation"]["deviation"])
            ),
            pairs=tuple((first, second) for first, second in config["pairs"]),
            held_out={name: [int(index) for index in own] for name, own in config["held_out"].items()},
            view=TypeAdapter(View).validate_python(config.get("view", "whole")),
            weights=load_file(folder / "model.safetensors"),
        )
        _check(checkpoint)
    except FileNotFoundError as error:
        raise UserError(f"{error.filename or folder} is missing; {mend}.") from error
    except (ValueError, TypeError, LookupError, AttributeError, MemoryError, RuntimeError, SafetensorError) as error:
        raise UserError(f"{folder} is damaged ({' '.join(str(error).split())[:120]}); delete it and {mend}.") from error
    return checkpoint
