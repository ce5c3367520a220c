"""All combinations that are tried for the sequences that begin with one object."""

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
from pipeline.pairing.combination import check_combination
from pipeline.pairing.grasps import SingleGrasp
from pipeline.pairing.readiness import Settled, ready
from pipeline.pairing.task import Task
from pipeline.records.parameters.merge import MergeParameters
from pipeline.records.tables import MERGED

CHUNK = 24  # most combinations of one task tried at once; not the number of workers, on which results must not depend
STORE = 20  # combinations in store for each that may be tried: those whose grasps are used up are passed over
SETTLING_SHARE = 0.1  # of the work on a first object, roughly: settling its grasps; for the progress bar
SPARE = 4  # combinations tried at once beyond those still wanted: some will be rejected

Place = tuple[int, str]  # number in the order of picking, and name, of an object


@dataclass(frozen=True)
class Inputs:
    """What is searched for one sequence of objects."""

    task: Task
    grasps: tuple[Sequence[SingleGrasp], ...]  # distinct validated ones of each object
    generator: np.random.Generator  # for the order of trial

    @property
    def places(self) -> list[Place]:
        """Its objects in the order of picking."""
        return [(number, item.name) for number, item in enumerate(self.task.objects)]


@dataclass
class _Search:
    """Where the search of one sequence stands."""

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


def _settling(inputs: Mapping[str, Inputs]) -> Work[dict[Place, list[Settled]]]:
    """Return the grasps of all objects with what can be said of each alone, those of one object once."""
    owners = {place: one for one in inputs.values() for place in one.places}
    tasks = {place: one.task for place, one in owners.items() if place[0] < len(one.task.objects) - 1}
    to_settle = [(place, grasp) for place in tasks for grasp in owners[place].grasps[place[0]]]
    found: dict[Place, list[Settled]] = {place: [] for place in owners}
    with Shared(tasks) as shared:
        settled = yield Calls(partial(_ready, shared), to_settle, 0.0, SETTLING_SHARE)
    for (place, _), one in zip(to_settle, settled, strict=True):
        found[place].append(one)
    for place, own in owners.items():
        if place not in tasks:  # nothing to do in physics
            found[place] = [ready(own.task, place[0], grasp) for grasp in own.grasps[place[0]]]
    return found


def _ready(shared: Shared[dict[Place, Task]], each: tuple[Place, SingleGrasp]) -> Settled:
    place, grasp = each
    return ready(shared.value[place], place[0], grasp)


def merging(inputs: Mapping[str, Inputs], keep: Callable[[str, pd.DataFrame], None]) -> Work[None]:
    """Give ``keep`` the table ``MERGED`` of every sequence: each tried combination with its outcome, in order of trial.

    Trying ends, for each sequence, with ``grasps_per_pair`` accepted rows, with ``most_combinations`` rows, or when
    nothing is left that would not use a single grasp more than ``most_per_grasp`` times. They go side by side.

    Args:
        inputs: by key; all with the same picks.
    """
    settled = yield from _settling(inputs)
    choices = {key: [settled[place] for place in one.places] for key, one in inputs.items()}
    searches = {}
    for key, one in inputs.items():
        settings = one.task.merge
        counts = [len(own) for own in choices[key]]
        order = random_order(counts, one.generator, STORE * settings.most_combinations)
        searches[key] = _Search(settings, order, [], [])
    wanted = sum(one.task.merge.grasps_per_pair for one in inputs.values())
    done = SETTLING_SHARE
    with Shared(({key: one.task for key, one in inputs.items()}, choices)) as shared:
        while searches:
            taken = {key: search.take() for key, search in searches.items()}
            for key in [key for key, own in taken.items() if not own]:
                keep(key, pd.DataFrame(searches.pop(key).rows, columns=MERGED.names, dtype=object))
            each = [(key, combination) for key, own in taken.items() for combination in own]
            if not each:
                continue
            share = (1 - done) * min(1.0, len(each) / max(wanted, 1))
            rows = yield Calls(partial(_try, shared), each, done, done + share)
            done += share
            for (key, combination), row in zip(each, rows, strict=True):
                accepted = len(searches[key].accepted)
                searches[key].record(combination, row)
                wanted -= len(searches[key].accepted) - accepted


def _try(
    shared: Shared[tuple[dict[str, Task], dict[str, list[list[Settled]]]]], each: tuple[str, Combination]
) -> dict[str, Any]:
    key, combination = each
    tasks, choices = shared.value
    return check_combination(tasks[key], [own[index] for own, index in zip(choices[key], combination, strict=True)])


def summary(table: pd.DataFrame) -> str:
    """Return one line: how many combinations were accepted, and what rejected the others, most frequent first."""
    reasons = table["rejected_by"].value_counts()
    rejected = [f"{reason} {count}" for reason, count in reasons.items() if reason]
    accepted = int((table["rejected_by"] == "").sum())
    return f"{accepted} accepted of {len(table)} tried" + (f" (rejected by {', '.join(rejected)})" if rejected else "")
