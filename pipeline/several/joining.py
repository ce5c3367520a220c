"""Single grasps of all objects of a sequence joined into one hand, as rows of ``records.tables.JOINED``."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from pipeline.compute.fan_out import Workers, fan_out
from pipeline.compute.shared import Shared
from pipeline.merge.draws import Combination, next_combinations, random_order
from pipeline.pairing.combination import Task, Verdict, check_combination
from pipeline.pairing.grasps import SingleGrasp, fingers_of
from pipeline.pairing.readiness import Settled, as_synthesized, ready_first, settled, settling_physics
from pipeline.records.parameters.several import SeveralParameters
from pipeline.records.poses import position_quaternion
from pipeline.records.tables import JOINED

CHUNK = 8  # combinations tried at once; not the number of workers, on which results must not depend
STORE = 20  # combinations in store for each that may be tried: those whose grasps are used up are passed over


def ready_grasps(task: Task, grasps: Sequence[Sequence[SingleGrasp]], workers: Workers) -> list[list[Settled]]:
    """Return the grasps of every object with what can be said of each alone; the last object has nothing to settle."""
    ready: list[list[Settled]] = []
    for number, own in enumerate(grasps):
        if number == len(grasps) - 1:
            ready.append([as_synthesized(grasp) for grasp in own])
            continue
        with Shared((task, number)) as shared:
            ready.append(fan_out(partial(_ready, shared), own, workers, f"settle {task.objects[number].name}"))
    return ready


def _ready(shared: Shared[tuple[Task, int]], grasp: SingleGrasp) -> Settled:
    task, number = shared.value
    physics = settling_physics(task.merge, task.physics, task.validate)
    waiting = fingers_of(task.groups[number + 1 :])
    if number == 0:
        return ready_first(task.objects[0], physics, grasp, waiting, task.supports[0])
    return settled(task.objects[number], physics, waiting, grasp)


def join_all(
    task: Task,
    ready: Sequence[Sequence[Settled]],
    sequence: SeveralParameters,
    rng: np.random.Generator,
    workers: Workers,
) -> pd.DataFrame:
    """Return the table ``JOINED``: every tried combination with its fate, in the order of trial.

    Trying ends with ``sequence.grasps`` accepted rows, with ``most_combinations`` rows, or when nothing is left that
    would not use a single grasp more than ``most_per_grasp`` times.
    """
    pending = random_order([len(own) for own in ready], rng, STORE * sequence.most_combinations)
    rows: list[dict[str, Any]] = []
    accepted: list[Combination] = []
    with Shared((task, ready)) as shared:
        while len(accepted) < sequence.grasps and len(rows) < sequence.most_combinations:
            count = min(CHUNK, sequence.most_combinations - len(rows))
            taken, pending = next_combinations(pending, accepted, sequence.most_per_grasp, count)
            if not taken:
                break
            label = f"join: {len(accepted)} of {sequence.grasps}"
            for combination, row in zip(taken, fan_out(partial(_try, shared), taken, workers, label), strict=True):
                if len(accepted) < sequence.grasps:
                    rows.append(row | {"merged_id": len(rows)})
                    accepted += [combination] if row["rejected_by"] == "" else []
    return pd.DataFrame(rows, columns=JOINED.names, dtype=object)


def _try(shared: Shared[tuple[Task, Sequence[Sequence[Settled]]]], combination: Combination) -> dict[str, Any]:
    task, ready = shared.value
    chosen = [own[index] for own, index in zip(ready, combination, strict=True)]
    return joined_row(task, check_combination(task, chosen))


def joined_row(task: Task, verdict: Verdict) -> dict[str, Any]:
    """Return a row of ``JOINED`` without its number."""
    grasp = verdict.grasp
    poses = [position_quaternion(T) for T in grasp.T_hand_object]
    reached = len(verdict.open_q)
    return {
        "objects": [item.name for item in task.objects],
        "fingers": ["+".join(single.fingers) for single in grasp.singles],
        "grasp_ids": [single.grasp_id for single in grasp.singles],
        "q": grasp.q,
        "squeeze_q": grasp.squeeze_q,
        "positions_hand_object": [position for position, _ in poses],
        "quaternions_hand_object": [quaternion for _, quaternion in poses],
        "open_q": verdict.open_q,
        "approach_directions": [grasp.singles[0].approach_direction, *verdict.approach_direction][:reached],
        "approach_lengths": verdict.approach_length,
        "sweep_penetrations": verdict.sweep_penetrations,
        "object_clearance": verdict.object_clearance,
        "hand_clearance": verdict.hand_clearance,
        "mount_clearance": verdict.mount_clearance,
        "gravity_drift": verdict.gravity_drift,
        "rejected_by": verdict.rejected_by,
    }
