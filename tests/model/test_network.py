import numpy as np
import pytest
import torch

from pipeline.model.clouds import prepare_cloud, stack
from pipeline.model.network import WAVE_NUMBERS, Encoder, GraspModel, cloud_tensors
from pipeline.records.parameters.train import DenoiserParameters

KINDS = ("mlp", "attention")


@pytest.fixture
def clouds(settings):
    rng = np.random.default_rng(0)
    return cloud_tensors(
        stack([prepare_cloud(rng.uniform(-0.04, 0.04, (200, 3)), settings.encoder, rng) for _ in range(4)])
    )


def model_of(settings, kind: str) -> GraspModel:
    torch.manual_seed(0)
    model = GraspModel(settings.encoder, DenoiserParameters(kind=kind, width=32, blocks=2, slot_width=4), 40)
    for parameter in model.parameters():  # nothing may hide behind weights that begin at zero
        torch.nn.init.normal_(parameter, std=0.2)
    return model


def test_encoder_is_the_maximum_over_neighbourhoods_of_a_small_network(settings, clouds):
    """Against a plain loop over centres, from the definition of a set abstraction."""
    torch.manual_seed(0)
    encoder = Encoder(settings.encoder)
    with torch.no_grad():
        tokens = encoder(clouds)
        for cloud in (0, 3):
            position = clouds.points[cloud]
            waves = [wave * position[:, axis] for axis in range(3) for wave in WAVE_NUMBERS]
            feature = torch.stack([f(wave) for f in (torch.sin, torch.cos) for wave in waves], dim=-1)
            for level, network in enumerate(encoder.levels):
                radius = settings.encoder.radii[level]
                new = []
                for centre, own in enumerate(clouds.neighbours[level][cloud]):
                    rows = [torch.cat([(position[j] - position[centre]) / radius, feature[j]]) for j in own.tolist()]
                    new.append(network(torch.stack(rows)).max(0).values)
                feature, position = torch.stack(new), position[: len(new)]
            torch.testing.assert_close(tokens[cloud], feature, atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_encoding_each_cloud_once_equals_encoding_it_for_every_grasp(settings, clouds, kind):
    model = model_of(settings, kind)
    pairs, pair = torch.tensor([[0, 2], [1, 2], [0, 3]]), torch.tensor([2, 0, 1, 1, 2])
    x, time = torch.randn(5, 40), torch.rand(5)
    with torch.no_grad():
        together = model(x, time, model.context(clouds, pairs), pair)
        for row in range(5):
            own = model.context(clouds.chosen(pairs[pair[row]]), torch.tensor([[0, 1]]))
            alone = model(x[row : row + 1], time[row : row + 1], own, torch.zeros(1, dtype=torch.long))
            torch.testing.assert_close(together[row], alone[0], atol=1e-4, rtol=1e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_prediction_depends_on_both_objects_their_order_and_the_time(settings, clouds, kind):
    model = model_of(settings, kind)
    zero, x = torch.zeros(1, dtype=torch.long), torch.randn(1, 40)

    def predict(first, second, time=0.5):
        with torch.no_grad():
            return model(x, torch.tensor([time]), model.context(clouds, torch.tensor([[first, second]])), zero)

    base = predict(0, 1)
    for other in (predict(2, 1), predict(0, 2), predict(1, 0), predict(0, 1, time=0.6)):
        assert (other - base).abs().max() > 1e-4


@pytest.mark.parametrize("kind", KINDS)
def test_every_weight_is_used(settings, clouds, kind):
    model = model_of(settings, kind)
    context = model.context(clouds, torch.tensor([[0, 1], [2, 3]]))
    model(torch.randn(6, 40), torch.rand(6), context, torch.tensor([0, 1, 0, 1, 0, 1])).square().sum().backward()
    unused = [name for name, value in model.named_parameters() if value.grad is None or not value.grad.any()]
    assert unused == []


def test_calibration_makes_features_of_objects_differ_by_their_spread(settings, clouds):
    model = model_of(settings, "mlp")
    model.calibrate(clouds)
    denoiser = model.denoiser
    with torch.no_grad():
        features = (denoiser.pool(model.encoder(clouds)) - denoiser.mean) / denoiser.spread
    torch.testing.assert_close(features.mean(0), torch.zeros(features.shape[1]), atol=1e-4, rtol=0)
    used = denoiser.spread > 0.0101
    assert used.any()
    torch.testing.assert_close(features.std(0, correction=0)[used], torch.ones(int(used.sum())), atol=1e-3, rtol=0)
