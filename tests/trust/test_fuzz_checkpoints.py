"""Damaged checkpoints, and made-up ones: weights and the text beside them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given

from pipeline.records.parameters.train import DenoiserParameters, DiffusionParameters, EncoderParameters
from tests.trust.damage import damaged, edits, examples, valid_or_one_sentence


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> Path:
    """A small checkpoint that was never trained."""
    from pipeline.model.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
    from pipeline.model.network import GraspModel
    from pipeline.model.representation import Normalisation

    encoder = EncoderParameters(points=16, clouds=1, centres=[8, 4, 2], neighbours=[4, 4, 2], widths=[4, 4, 4])
    denoiser = DenoiserParameters(width=8, blocks=1, slot_width=2)
    weights = GraspModel(encoder, denoiser, 34).state_dict()
    folder = tmp_path_factory.mktemp("checkpoint") / "train"
    normalisation = Normalisation(np.zeros(34), np.ones(34))
    checkpoint = Checkpoint(
        "allegro", encoder, denoiser, DiffusionParameters(), normalisation, (("a", "b"),), {}, weights
    )
    write_checkpoint(folder, checkpoint, [{"step": 1.0, "training_loss": 1.0}])
    read_checkpoint(folder)
    return folder


@pytest.mark.parametrize("name", ["model.json", "model.safetensors"])
@examples(15)
@given(changes=edits)
def test_damage(sound, tmp_path_factory, name, changes):
    from pipeline.model.checkpoint import read_checkpoint

    folder = tmp_path_factory.mktemp("damaged") / "train"
    shutil.copytree(sound, folder)
    (folder / name).write_bytes(damaged((folder / name).read_bytes(), changes))
    valid_or_one_sentence(lambda: read_checkpoint(folder))
    shutil.rmtree(folder)


@pytest.mark.parametrize(
    ("path", "value", "word"),
    [
        (("encoder", "widths"), [10**9, 10**9, 10**9], "damaged"),
        (("encoder", "widths"), [60000, 60000, 60000], "not those of the network"),
        (("denoiser", "width"), 2048, "not those of the network"),
        (("normalisation", "mean"), [float("nan")] * 34, "not finite"),
        (("normalisation", "mean"), "x", "damaged"),
        (("pairs",), [[1]], "damaged"),
        (("held_out",), [], "damaged"),
        (("format",), {}, "another version"),
    ],
)
def test_a_description_that_does_not_fit_is_refused_before_room_is_made(sound, tmp_path, path, value, word):
    from pipeline.model.checkpoint import read_checkpoint

    folder = tmp_path / "train"
    shutil.copytree(sound, folder)
    content = json.loads((folder / "model.json").read_text())
    section = content
    for key in path[:-1]:
        section = section[key]
    section[path[-1]] = value
    (folder / "model.json").write_text(json.dumps(content))
    assert word in valid_or_one_sentence(lambda: read_checkpoint(folder))


def test_weights_that_are_no_numbers_are_refused(sound, tmp_path):
    from safetensors.torch import load_file, save_file

    from pipeline.model.checkpoint import read_checkpoint

    folder = tmp_path / "train"
    shutil.copytree(sound, folder)
    weights = load_file(folder / "model.safetensors")
    name = min(weights)
    save_file(weights | {name: weights[name] * float("nan")}, folder / "model.safetensors")
    assert "not finite" in valid_or_one_sentence(lambda: read_checkpoint(folder))
