import dataclasses
import json

import numpy as np
import pytest
import torch

from pipeline.hand.model import load_hand
from pipeline.model.checkpoint import read_checkpoint, write_checkpoint
from pipeline.model.representation import from_vectors
from pipeline.records.errors import UserError
from pipeline.train import training
from pipeline.train.data import gather_examples

HAND = load_hand("allegro")


@pytest.fixture(scope="module")
def examples(tables, objects, settings):
    return gather_examples(tables, objects, settings.data, settings.encoder, 1)


@pytest.fixture(scope="module")
def trained(examples, settings, tmp_path_factory):
    return training.train(examples, settings, 1, tmp_path_factory.mktemp("state") / "state.pt", HAND)


def with_optimization(settings, **changes):
    return settings.model_copy(update={"optimization": settings.optimization.model_copy(update=changes)})


def test_a_killed_run_resumes_to_the_same_bytes(examples, settings, trained, tmp_path, monkeypatch):
    state, original, calls = tmp_path / "state.pt", training.loss_of, []

    def killed(model, batch, pairs, own):
        calls.append(model.training)
        if sum(calls) > 7:
            raise KeyboardInterrupt
        return original(model, batch, pairs, own)

    monkeypatch.setattr(training, "loss_of", killed)
    with pytest.raises(KeyboardInterrupt):
        training.train(examples, settings, 1, state, HAND)
    assert torch.load(state, weights_only=True)["step"] == 4
    monkeypatch.setattr(training, "loss_of", original)
    checkpoint, history = training.train(examples, settings, 1, state, HAND)
    for name in ("whole", "resumed"):
        write_checkpoint(tmp_path / name, *(trained if name == "whole" else (checkpoint, history)))
    for name in ("model.safetensors", "model.json", "history.csv"):
        assert (tmp_path / "whole" / name).read_bytes() == (tmp_path / "resumed" / name).read_bytes(), name


@pytest.mark.parametrize(("changes", "code"), [({"learning_rate": 0.01}, ""), ({}, "other")])
def test_another_run_s_state_is_not_resumed(examples, settings, trained, tmp_path, changes, code):
    state = tmp_path / "state.pt"
    training.train(examples, with_optimization(settings, **changes), 1, state, HAND, code)
    spoilt = torch.load(state, weights_only=True)
    for weights in spoilt["average"].values():
        weights.zero_()  # so that it would be seen
    torch.save(spoilt, state)
    checkpoint, _ = training.train(examples, settings, 1, state, HAND)
    assert all(torch.equal(value, trained[0].weights[name]) for name, value in checkpoint.weights.items())
    state.write_bytes(b"half a fi")
    checkpoint, _ = training.train(examples, settings, 1, state, HAND)
    assert all(torch.equal(value, trained[0].weights[name]) for name, value in checkpoint.weights.items())


def test_what_a_model_says_it_was_not_trained_on_is_part_of_its_identity(examples, settings):
    renamed = dataclasses.replace(examples, held_out={name: [99] for name in examples.held_out})
    identities = [training.training_identity(each, settings, 1, "") for each in (examples, renamed)]
    assert identities[0] != identities[1]


def test_the_curve_has_a_point_per_record_with_both_losses(trained, settings):
    _, history = trained
    assert [point["step"] for point in history] == [4, 8, 12]
    assert all({"training_loss", "held_out_loss", "epoch", "learning_rate"} <= point.keys() for point in history)


@pytest.mark.parametrize(
    ("objective", "schedule", "kind"),
    [("clean", "cosine", "mlp"), ("flow", "cosine", "mlp"), ("epsilon", "published", "attention")],
)
def test_every_objective_learns(examples, settings, tmp_path, objective, schedule, kind):
    own = with_optimization(settings, steps=150, record_every=30, learning_rate=3e-3).model_copy(
        update={
            "diffusion": settings.diffusion.model_copy(update={"objective": objective, "schedule": schedule}),
            "denoiser": settings.denoiser.model_copy(update={"kind": kind}),
        }
    )
    _, history = training.train(examples, own, 1, tmp_path / "state.pt", HAND)
    assert history[-1]["training_loss"] < 0.95 * history[0]["training_loss"]


def test_a_checkpoint_survives_and_a_broken_one_is_named(trained, tmp_path):
    folder = tmp_path / "model"
    write_checkpoint(folder, *trained)
    found = read_checkpoint(folder)
    assert found.pairs == trained[0].pairs and found.diffusion == trained[0].diffusion
    assert all(torch.equal(value, trained[0].weights[name]) for name, value in found.weights.items())
    config = json.loads((folder / "model.json").read_text())
    (folder / "model.json").write_text(json.dumps(config | {"format": 99}))
    with pytest.raises(UserError, match="another version"):
        read_checkpoint(folder)
    (folder / "model.json").write_text(json.dumps(config | {"pairs": 3}))
    with pytest.raises(UserError, match="damaged"):
        read_checkpoint(folder)
    (folder / "model.json").write_text(json.dumps(config))
    (folder / "model.safetensors").write_bytes(b"x")
    with pytest.raises(UserError, match="damaged"):
        read_checkpoint(folder)
    with pytest.raises(UserError, match="missing; run `dvc repro train`"):
        read_checkpoint(tmp_path / "none")


def test_objects_are_turned_with_their_grasps(tables, objects, settings):
    """In the hand's frame every point of a cloud stays where it was."""
    hand = load_hand("allegro")
    in_hand = []
    for turned in (False, True):
        data = settings.data.model_copy(update={"yaw_augmentation": turned, "cloud_noise": 0.0})
        own = settings.model_copy(update={"data": data})
        examples = gather_examples(tables, objects, data, settings.encoder, 1)
        one_draw = dataclasses.replace(
            examples,
            clouds=dataclasses.replace(
                examples.clouds, points=np.repeat(examples.clouds.points[:: settings.encoder.clouds], 2, axis=0)
            ),
        )
        source = training.Source(one_draw, own, 1, "training", hand)
        rows = source.rows[:20]
        batch = source.batch(3, rows)
        grasps = from_vectors(hand, source.normalisation.undo(batch.clean.numpy().astype(np.float64)))
        points = batch.clouds.points.numpy()[examples.pair_objects()[examples.pair[rows]]]  # (20, 2, n, 3)
        T = grasps.T_hand_object
        in_hand.append(np.einsum("bsij,bsnj->bsni", T[..., :3, :3], points) + T[..., None, :3, 3])
        in_hand.append(T)
    np.testing.assert_allclose(in_hand[0], in_hand[2], atol=2e-6)
    assert np.abs(in_hand[1][..., :3, :3] - in_hand[3][..., :3, :3]).max() > 0.5
