"""Noise, what is predicted from it, and the way back.

All processes here have the form x_t = signal(t) x_0 + noise(t) eps with t from 0 (a grasp) to 1 (noise):

    cosine      signal = cos(pi t / 2), noise = sin(pi t / 2); Nichol & Dhariwal 2021, without their offset
    published   100 linear betas 1e-4 .. 1e-2; signal(1) = 0.776, so that it never becomes noise though sampling begins
                with noise: kept for comparison
    line        signal = 1 - t, noise = t: flow matching (Lipman et al. 2023), used by the objective ``flow``

Whatever a network predicts is turned into x_0 and eps, so that every sampler works with every objective.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import torch
from torch import Tensor

from pipeline.records.parameters.train import DiffusionParameters

PUBLISHED_STEPS = 100
# Sampling begins just before t = 1, where the noise alone says nothing of x_0 (0.98 for noise prediction, whose
# division by the signal would blow up errors).
LATEST = {"clean": 0.998, "epsilon": 0.98, "flow": 0.998}


@lru_cache(maxsize=1)
def _published_signal() -> Tensor:
    betas = torch.linspace(1e-4, 1e-2, PUBLISHED_STEPS, dtype=torch.float64)
    return torch.cat([torch.ones(1, dtype=torch.float64), torch.cumprod(1 - betas, 0).sqrt()])


def signal_and_noise(settings: DiffusionParameters, time: Tensor) -> tuple[Tensor, Tensor]:
    """Return signal and noise, each of the shape of ``time``, in 0..1."""
    if settings.objective == "flow":
        return 1 - time, time
    if settings.schedule == "cosine":
        return torch.cos(time * math.pi / 2), torch.sin(time * math.pi / 2)
    table = _published_signal().to(time)
    place = time * PUBLISHED_STEPS
    low = place.floor().clamp(0, PUBLISHED_STEPS - 1).long()
    signal = torch.lerp(table[low], table[low + 1], place - low)
    return signal, (1 - signal**2).clamp(min=0).sqrt()


def latest_time(settings: DiffusionParameters) -> float:
    """Return where sampling begins."""
    return 1.0 if settings.objective != "flow" and settings.schedule == "published" else LATEST[settings.objective]


def target(settings: DiffusionParameters, clean: Tensor, eps: Tensor) -> Tensor:
    """Return what the network is to predict."""
    return {"clean": clean, "epsilon": eps, "flow": eps - clean}[settings.objective]


def clean_and_noise(
    settings: DiffusionParameters, prediction: Tensor, x: Tensor, signal: Tensor, noise: Tensor
) -> tuple[Tensor, Tensor]:
    """Return the x_0 and eps that a prediction at x implies."""
    if settings.objective == "clean":
        return prediction, (x - signal * prediction) / noise
    if settings.objective == "epsilon":
        return (x - noise * prediction) / signal, prediction
    return x - noise * prediction, x + signal * prediction


def draw(
    settings: DiffusionParameters,
    predict: Callable[[Tensor, Tensor], Tensor],
    shape: tuple[int, int],
    sampler: str,
    steps: int,
    generator: torch.Generator,
) -> Tensor:
    """Return samples of ``shape``.

    Args:
        predict: the network, from x (B, d) and times (B,).
        sampler: ``ddim`` (no noise on the way; Euler steps for a line), ``ancestral`` (noise on the way), or ``dpm``
            (second order, DPM-Solver++ 2M, Lu et al. 2022).
        steps: evaluations of the network.
    """
    device = generator.device
    times = torch.linspace(latest_time(settings), 0.0, steps + 1, device=device, dtype=torch.float64)
    signals, noises = signal_and_noise(settings, times)
    x = torch.randn(shape, generator=generator, device=device)
    before: tuple[Tensor, Tensor] | None = (
        None  # the x_0 of the step before, and that step's width in log(signal / noise)
    )
    for index in range(steps):
        a, s = signals[index].float(), noises[index].float()
        a_next, s_next = signals[index + 1].float(), noises[index + 1].float()
        clean, eps = clean_and_noise(settings, predict(x, times[index].float().expand(shape[0])), x, a, s)
        if index == steps - 1:
            return clean
        if sampler == "ddim":
            x = a_next * clean + s_next * eps
        elif sampler == "ancestral":
            # The process is Markov: x_t given x_next is normal with mean (a / a_next) x_next, which gives the variance
            # of x_next given x_t and x_0.
            variance = s_next**2 * (1 - (a / a_next * s_next / s) ** 2)
            fresh = torch.randn(shape, generator=generator, device=device)
            x = a_next * clean + (s_next**2 - variance).clamp(min=0).sqrt() * eps + variance.sqrt() * fresh
        else:
            width = torch.log(a_next / s_next) - torch.log(a / s)
            mean = clean
            if before is not None:
                mean = clean + (clean - before[0]) * width / (2 * before[1])
            x = s_next / s * x - a_next * torch.expm1(-width) * mean
            before = clean, width
    raise AssertionError("at least one step")
