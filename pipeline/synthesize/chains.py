"""Annealed Metropolis-adjusted Langevin chains on the grasp energy.

A proposal goes down the gradient, each degree of freedom scaled by the running root mean square of its own slope
(per grasp), plus Langevin noise; some contacts are drawn anew. It is accepted by Metropolis' rule at a temperature
that falls; proposals with a contact used twice are rejected. Step and temperature follow the published schedule, its
periods shortened with the chain. The state of lowest energy, of all starts of a chain where it has several, is kept
and polished: short RMSprop steps without noise, its contacts fixed.

A chain is determined by its first state and its seed, whatever chains run beside it. The exception is the released
code's preconditioner, one for a whole batch: with it a chain is determined by its batch.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.energy.scene import EnergyScene, Grasps, chosen, read_grasps, read_terms
from pipeline.records.energy_terms import Terms
from pipeline.records.parameters.synthesize import OptimizerParameters

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
    schedule.shared, schedule.repeats = int(optimizer.shared_preconditioner), int(optimizer.duplicate_contacts)
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


def launch_chains(
    scene: EnergyScene,
    optimizer: OptimizerParameters,
    iterations: int,
    current: Any,
    best: Any,
    slots: Sequence[NDArray[np.float64]],
    free: NDArray[np.bool_],
    seeds: NDArray[np.int64],
) -> None:
    """Move ``current`` by Metropolis-adjusted steps in place; ``best`` is replaced by every better state.

    Args:
        iterations: number of steps; the schedule is fitted to it.
        current: ``kernel.States`` of B chains; evaluated here.
        best: the same, holding the best states so far; evaluated here.
        slots: per contact, the chance (C,) of every candidate; see ``energy.scene.contact_slots``.
        free: (J,) joints that may move.
        seeds: (B,) 31-bit seeds of the chains.
    """
    wp, kernel, count = scene.wp, scene.kernel, len(seeds)
    grasps = read_grasps(current)
    proposal, scratch = scene.states(grasps), scene.scratch(grasps)
    weights = scene.weights()
    for states in (current, best):
        scene.launch_evaluation(states, scratch, weights)
    schedule = _schedule(scene, optimizer, iterations, slots, free)
    mean_square = wp.zeros((count, kernel.POSE + scene.joint_count), dtype=float, device=scene.device)
    seed_array = wp.array(seeds.astype(np.int32), dtype=int, device=scene.device)
    energy = [scene.hand, scene.scene, weights]
    if not optimizer.shared_preconditioner:
        moved = [schedule, current, proposal, best, scratch, mean_square, seed_array, iterations]
        wp.launch(kernel.anneal_kernel, dim=count, inputs=energy + moved, device=scene.device)
        return

    def recorded(kernel: Any, dim: int, *inputs: Any) -> Any:
        return wp.launch(kernel, dim=dim, inputs=list(inputs), device=scene.device, record_cmd=True)

    share = recorded(kernel.share_slopes_kernel, kernel.POSE + scene.joint_count, schedule, current, mean_square)
    proposed = (schedule, current, proposal, scratch, mean_square, seed_array, 0)
    propose = recorded(kernel.propose_kernel, count, *energy, *proposed)
    decide = recorded(kernel.decide_kernel, count, schedule, current, proposal, best, seed_array, 0)
    for iteration in range(iterations):
        propose.set_param_at_index(len(energy) + len(proposed) - 1, iteration)
        decide.set_param_at_index(5, iteration)
        share.launch()
        propose.launch()
        decide.launch()


def run_chains(
    scene: EnergyScene,
    optimizer: OptimizerParameters,
    iterations: int,
    first: Grasps,
    slots: Sequence[NDArray[np.float64]],
    free: NDArray[np.bool_],
    seeds: NDArray[np.int64],
    starts: int = 1,
) -> tuple[Grasps, Terms]:
    """Return what every chain ends with, and its terms: the best state (or the last one) annealed, then polished.

    Args:
        iterations: length of each start, before polishing.
        first: (B * starts,) first states, the starts of a chain one after the other.
        slots, free: see :func:`launch_chains`.
        seeds: (B * starts,) 31-bit seeds of the starts.
        starts: how many a chain has; all are annealed, the one of lowest energy is polished.
    """
    current, best = scene.states(first), scene.states(first)
    launch_chains(scene, optimizer, iterations, current, best, slots, free, seeds)
    best = best if optimizer.keep_best else current
    if starts > 1:
        energy = best.energy.numpy().reshape(-1, starts)
        lowest = starts * np.arange(len(energy)) + energy.argmin(axis=1)
        best, seeds = scene.states(chosen(read_grasps(best), lowest)), seeds[lowest]
        scene.launch_evaluation(best, scene.scratch(read_grasps(best)), scene.weights())
    if optimizer.polish_iterations > 0:
        current = scene.states(read_grasps(best))
        launch_chains(scene, _polish(optimizer), optimizer.polish_iterations, current, best, slots, free, seeds)
    return read_grasps(best), read_terms(best)
