"""Samplers against a distribution whose best denoiser is known in closed form."""

import pytest
import torch

from pipeline.model.diffusion import clean_and_noise, draw, latest_time, signal_and_noise, target
from pipeline.records.parameters.train import DiffusionParameters

MEAN, DEVIATION = 1.5, 0.3
OBJECTIVES = [("clean", "cosine"), ("epsilon", "cosine"), ("flow", "cosine")]


def best_prediction(settings):
    """The exact expectation of the target given x, for x_0 normal with MEAN and DEVIATION."""

    def predict(x, time):
        signal, noise = (value[:, None] for value in signal_and_noise(settings, time))
        clean = MEAN + signal * DEVIATION**2 / (signal**2 * DEVIATION**2 + noise**2) * (x - signal * MEAN)
        return target(settings, clean, (x - signal * clean) / noise)

    return predict


@pytest.mark.parametrize(("objective", "schedule"), OBJECTIVES)
@pytest.mark.parametrize(
    ("sampler", "steps", "tolerance"), [("ddim", 50, 0.05), ("ancestral", 200, 0.03), ("dpm", 25, 0.05)]
)
def test_samples_have_the_mean_and_spread_of_the_truth(objective, schedule, sampler, steps, tolerance):
    settings = DiffusionParameters(objective=objective, schedule=schedule)
    samples = draw(settings, best_prediction(settings), (20000, 1), sampler, steps, torch.Generator().manual_seed(0))
    assert abs(samples.mean() - MEAN) < 0.06  # begins at t < 1, where a little of x_0 is still there
    assert abs(samples.std() - DEVIATION) < tolerance


@pytest.mark.parametrize("objective", ["clean", "epsilon", "flow"])
def test_prediction_of_the_target_gives_back_grasp_and_noise(objective):
    settings = DiffusionParameters(objective=objective)
    clean, eps, time = torch.randn(8, 40), torch.randn(8, 40), torch.linspace(0.05, 0.95, 8)
    signal, noise = (value[:, None] for value in signal_and_noise(settings, time))
    x = signal * clean + noise * eps
    found = clean_and_noise(settings, target(settings, clean, eps), x, signal, noise)
    torch.testing.assert_close(found[0], clean, atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(found[1], eps, atol=1e-4, rtol=1e-4)


def test_published_schedule_never_becomes_noise_and_cosine_does():
    time = torch.tensor([0.0, 1.0], dtype=torch.float64)
    published = DiffusionParameters(objective="epsilon", schedule="published")
    signal, noise = signal_and_noise(published, time)
    # Product of 1 - beta over the published betas, from its logarithm.
    expected = sum(torch.log1p(-torch.tensor(1e-4 + i * (1e-2 - 1e-4) / 99, dtype=torch.float64)) for i in range(100))
    torch.testing.assert_close(signal[1] ** 2, torch.exp(expected))
    assert 0.60 < signal[1] ** 2 < 0.605 and signal[0] == 1 and noise[0] == 0
    assert latest_time(published) == 1
    signal, noise = signal_and_noise(DiffusionParameters(), time)
    assert signal[1] < 1e-12 and noise[1] == 1
