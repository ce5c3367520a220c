"""All combinations that are tried for the pairs of one first object."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from pipeline.compute.pool import Calls, Work
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
SETTLING_SHARE = 0.1  # of the work on a first object, roughly: settling its grasps; for the progress bar
SPARE = 4  # combinations tried at once beyond those still wanted: some will be rejected


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


def merging(
    pairs: Mapping[str, Pair],
    physics: PhysicsParameters | None,
    grasps: Sequence[SingleGrasp],
    seconds: Mapping[str, Sequence[SingleGrasp]],
    generators: Mapping[str, np.random.Generator],
    keep: Callable[[str, pd.DataFrame], None],
) -> Work[None]:
    """Give ``keep`` the table ``MERGED`` of every pair: each tried combination with its outcome, in the order of trial.

    Trying ends, pair by pair, with ``grasps_per_pair`` accepted rows, with ``most_combinations`` rows, or when nothing
    is left that would not use a single grasp more than ``most_per_grasp`` times. The pairs go side by side.

    Args:
        pairs: with the same first object; by the name of the second object, as ``seconds`` and ``generators``.
        physics: in which the grasps of the first object settle, see :func:`ready_first`.
        grasps, seconds: distinct validated grasps of the first object and of the second ones.
    """
    object0 = next(iter(pairs.values())).object0
    with Shared((object0, physics)) as settling:
        firsts = yield Calls(partial(_ready, settling), grasps, 0.0, SETTLING_SHARE)
    searches = {}
    for name, pair in pairs.items():
        store = STORE * pair.merge.most_combinations
        order = random_order((len(firsts), len(seconds[name])), generators[name], store)
        searches[name] = _Search(pair.merge, order, [], [])
    wanted = sum(pair.merge.grasps_per_pair for pair in pairs.values())
    done = SETTLING_SHARE
    with Shared(_Inputs(pairs, firsts, seconds)) as shared:
        while searches:
            tasks = {name: search.take() for name, search in searches.items()}
            for name in [name for name, taken in tasks.items() if not taken]:
                keep(name, pd.DataFrame(searches.pop(name).rows, columns=MERGED.names, dtype=object))
            both = [(name, combination) for name, taken in tasks.items() for combination in taken]
            if not both:
                continue
            share = (1 - done) * min(1.0, len(both) / max(wanted, 1))
            rows = yield Calls(partial(_try, shared), both, done, done + share)
            done += share
            for (name, combination), row in zip(both, rows, strict=True):
                accepted = len(searches[name].accepted)
                searches[name].record(combination, row)
                wanted -= len(searches[name].accepted) - accepted


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
