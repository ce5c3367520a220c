"""All combinations that are tried for the pairs of one first object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from pipeline.compute.fan_out import Workers, fan_out
from pipeline.compute.shared import Shared
from pipeline.merge.draws import Combination, next_combinations, random_order
from pipeline.pairing.combination import Pair, try_combination
from pipeline.pairing.grasps import SingleGrasp
from pipeline.pairing.readiness import ReadyFirst, ready_first
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.merge import MergeParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.tables import MERGED

CHUNK = 24  # most combinations of a pair tried at once; not the number of workers, on which results must not depend
STORE = 20  # combinations in store for each that may be tried: those whose grasps are used up are passed over
SPARE = 4  # combinations tried at once beyond those still wanted: some will be rejected


def ready_firsts(
    object0: PreparedObject, physics: PhysicsParameters | None, grasps: Sequence[SingleGrasp], workers: Workers
) -> list[ReadyFirst]:
    """Return every pinch grasp with what can be said of it alone; see :func:`ready_first`."""
    with Shared((object0, physics)) as shared:
        return fan_out(partial(_ready, shared), grasps, workers, f"settle {object0.name}")


def _ready(shared: Shared[tuple[PreparedObject, PhysicsParameters | None]], grasp: SingleGrasp) -> ReadyFirst:
    return ready_first(*shared.value, grasp)


@dataclass
class _Search:
    """Where the search of one pair stands."""

    settings: MergeParameters
    pending: list[Combination]
    rows: list[dict[str, Any]]
    accepted: list[Combination]

    def take(self) -> list[Combination]:
        """Return the combinations to try next, none when the search is over."""
        wanted = self.settings.grasps_per_pair - len(self.accepted)
        count = min(CHUNK, wanted + SPARE, self.settings.most_combinations - len(self.rows))
        if wanted <= 0 or count <= 0:
            return []
        taken, self.pending = next_combinations(self.pending, self.accepted, self.settings.most_per_grasp, count)
        return taken

    def record(self, combination: Combination, row: dict[str, Any]) -> None:
        """Keep the row of a tried combination, unless enough have been accepted before it."""
        if len(self.accepted) < self.settings.grasps_per_pair:
            self.rows.append(row | {"merged_id": len(self.rows)})
            if row["rejected_by"] == "":
                self.accepted.append(combination)


@dataclass(frozen=True)
class _Inputs:
    pairs: Mapping[str, Pair]
    firsts: Sequence[ReadyFirst]
    seconds: Mapping[str, Sequence[SingleGrasp]]


def merge_pairs(
    pairs: Mapping[str, Pair],
    firsts: Sequence[ReadyFirst],
    seconds: Mapping[str, Sequence[SingleGrasp]],
    generators: Mapping[str, np.random.Generator],
    workers: Workers,
) -> dict[str, pd.DataFrame]:
    """Return the tables ``MERGED`` of pairs: every tried combination with its fate, in the order of trial.

    Trying ends, pair by pair, with ``grasps_per_pair`` accepted rows, with ``most_combinations`` rows, or when nothing
    is left that would not use a single grasp more than ``most_per_grasp`` times. The pairs go side by side, so that no
    worker waits for the last combination of each.

    Args:
        pairs: by the name of the second object, as ``seconds`` and ``generators``.
        firsts, seconds: distinct validated grasps of the objects.
    """
    searches = {}
    for name, pair in pairs.items():
        store = STORE * pair.merge.most_combinations
        order = random_order((len(firsts), len(seconds[name])), generators[name], store)
        searches[name] = _Search(pair.merge, order, [], [])
    with Shared(_Inputs(pairs, firsts, seconds)) as shared:
        while tasks := [(name, taken) for name, search in searches.items() for taken in search.take()]:
            accepted = sum(len(search.accepted) for search in searches.values())
            wanted = sum(pair.merge.grasps_per_pair for pair in pairs.values())
            label = f"{next(iter(pairs.values())).object0.name}: {accepted} of {wanted}"
            rows = fan_out(partial(_try, shared), tasks, workers, label)
            for (name, combination), row in zip(tasks, rows, strict=True):
                searches[name].record(combination, row)
    return {name: pd.DataFrame(search.rows, columns=MERGED.names, dtype=object) for name, search in searches.items()}


def _try(shared: Shared[_Inputs], task: tuple[str, Combination]) -> dict[str, Any]:
    name, (first, second) = task
    inputs = shared.value
    return try_combination(inputs.pairs[name], inputs.firsts[first], inputs.seconds[name][second])


def summary(table: pd.DataFrame) -> str:
    """Return one line: how many combinations were accepted, and what rejected the others, most frequent first."""
    reasons = table["rejected_by"].value_counts()
    rejected = [f"{reason} {count}" for reason, count in reasons.items() if reason]
    accepted = int((table["rejected_by"] == "").sum())
    return f"{accepted} accepted of {len(table)} tried" + (f" (rejected by {', '.join(rejected)})" if rejected else "")
