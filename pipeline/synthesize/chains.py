"""Annealed Metropolis-adjusted Langevin chains on the grasp energy.

A proposal goes down the gradient, each degree of freedom scaled by the running root mean square of its own slope
(per grasp), plus Langevin noise; some contacts are drawn anew. It is accepted by Metropolis' rule at a temperature
that falls; proposals with a contact used twice are rejected. Step and temperature follow the published schedule, its
periods shortened with the chain. The state of lowest energy is kept and polished: short RMSprop steps without noise,
its contacts fixed.

A chain is determined by its first state and its seed, whatever chains run beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.records.parameters.synthesize import OptimizerParameters
from pipeline.synthesize.energy import EnergyScene, Grasps, Terms, read_grasps, read_terms

PUBLISHED_ITERATIONS = 6000  # the decay periods of the optimizer's parameters belong to chains of this length
ALWAYS = 1e30  # a temperature at which every proposal is accepted


def _schedule(
    scene: EnergyScene,
    optimizer: OptimizerParameters,
    iterations: int,
    slots: Sequence[NDArray[np.float64]],
    free: NDArray[np.bool_],
) -> Any:
    wp, device = scene.wp, scene.device
    candidates = [np.flatnonzero(slot) for slot in slots]
    cumulative = [np.cumsum(slot[own]) for slot, own in zip(slots, candidates, strict=True)]
    schedule = scene.kernel.Schedule()
    schedule.step, schedule.step_decay = optimizer.step, optimizer.step_decay
    schedule.step_period = optimizer.step_period * iterations / PUBLISHED_ITERATIONS
    schedule.temperature, schedule.temperature_decay = optimizer.temperature, optimizer.temperature_decay
    schedule.temperature_period = optimizer.temperature_period * iterations / PUBLISHED_ITERATIONS
    schedule.switch_probability, schedule.noise = optimizer.switch_probability, optimizer.noise
    schedule.memory = optimizer.momentum
    degrees = np.concatenate([np.ones(scene.kernel.POSE), free.astype(float)])
    schedule.free = wp.array(degrees.astype(np.float32), dtype=float, device=device)
    starts = np.cumsum([0, *(len(own) for own in candidates)])
    schedule.slot_start = wp.array(starts.astype(np.int32), dtype=int, device=device)
    schedule.slot_candidate = wp.array(np.concatenate(candidates).astype(np.int32), dtype=int, device=device)
    schedule.slot_cumulative = wp.array(np.concatenate(cumulative).astype(np.float32), dtype=float, device=device)
    return schedule


def _polish(optimizer: OptimizerParameters) -> OptimizerParameters:
    """Settings of the last phase: from ``polish_step`` downwards, no noise, contacts fixed."""
    return optimizer.model_copy(
        update={
            "step": optimizer.polish_step,
            "step_period": 10 * PUBLISHED_ITERATIONS // max(optimizer.polish_iterations, 1),
            "step_decay": 0.7,
            "temperature": ALWAYS,
            "temperature_decay": 1.0,
            "switch_probability": 0.0,
            "noise": 0.0,
        }
    )


def run_chains(
    scene: EnergyScene,
    optimizer: OptimizerParameters,
    iterations: int,
    first: Grasps,
    slots: Sequence[NDArray[np.float64]],
    free: NDArray[np.bool_],
    seeds: NDArray[np.int64],
) -> tuple[Grasps, Terms]:
    """Return the best state of every chain and its terms.

    Args:
        iterations: length of each chain, before polishing.
        first: (B,) first states.
        slots: per contact, the chance of every candidate; see ``energy.contact_slots``.
        free: (16,) joints that may move.
        seeds: (B,) 31-bit seeds of the chains.
    """
    wp, kernel = scene.wp, scene.kernel
    current, proposal, best = scene.states(first), scene.states(first), scene.states(first)
    scratch = scene.scratch(first)
    seed_array = wp.array(seeds.astype(np.int32), dtype=int, device=scene.device)

    def anneal(settings: OptimizerParameters, length: int) -> None:
        schedule = _schedule(scene, settings, length, slots, free)
        mean_square = wp.zeros((len(first), kernel.DEGREES), dtype=float, device=scene.device)
        wp.launch(
            kernel.anneal_kernel,
            dim=len(first),
            inputs=[
                scene.hand, scene.scene, scene.weights, schedule, current, proposal, best, scratch, mean_square,
                seed_array, 0, length,
            ],
            device=scene.device,
        )  # fmt: skip

    scene.launch_evaluation(current, scratch)
    scene.launch_evaluation(best, scratch)
    anneal(optimizer, iterations)
    if optimizer.polish_iterations > 0:
        current = scene.states(read_grasps(best))
        scene.launch_evaluation(current, scratch)
        anneal(_polish(optimizer), optimizer.polish_iterations)
    return read_grasps(best), read_terms(best)
