"""All combinations that are tried for the sequences that begin with one object."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from pipeline.compute.pool import Calls, Work
from pipeline.compute.shared import Shared
from pipeline.merge.draws import Combination, next_combinations, random_order
from pipeline.pairing.combination import checked, combine, measured
from pipeline.pairing.grasps import SingleGrasp
from pipeline.pairing.readiness import Settled, ready
from pipeline.pairing.task import Task
from pipeline.records.parameters.merge import MergeParameters
from pipeline.records.tables import MERGED
from pipeline.robustness.measures import most_measured

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


@dataclass(frozen=True)
class _Call:
    """A combination of one sequence that is tried or, once it was accepted, measured."""

    key: str
    combination: Combination
    row: int | None = None  # to which its measures belong; None: it is tried


@dataclass
class _Search:
    """Where the search of one sequence stands."""

    key: str
    settings: MergeParameters
    most_measured: float
    pending: list[Combination]
    rows: list[dict[str, Any]] = field(default_factory=list)
    accepted: list[Combination] = field(default_factory=list)
    unmeasured: list[_Call] = field(default_factory=list)

    def calls(self) -> list[_Call]:
        """Return what is to be done next, nothing when the search is over."""
        measured, self.unmeasured = self.unmeasured, []
        return measured + [_Call(self.key, combination) for combination in self._take()]

    def _take(self) -> list[Combination]:
        wanted = self.settings.grasps_per_pair - len(self.accepted)
        count = min(CHUNK, wanted + SPARE, self.settings.most_combinations - len(self.rows))
        if wanted <= 0 or count <= 0:
            return []
        taken, self.pending = next_combinations(self.pending, self.accepted, self.settings.most_per_grasp, count)
        return taken

    def record(self, call: _Call, columns: dict[str, Any]) -> None:
        """Keep the measures, or the row of a tried combination, unless enough have been accepted before it."""
        if call.row is not None:
            self.rows[call.row] |= columns
        elif len(self.accepted) < self.settings.grasps_per_pair:
            self.rows.append(columns | {"merged_id": len(self.rows)})
            if columns["rejected_by"] == "":
                self.accepted.append(call.combination)
                if len(self.accepted) <= self.most_measured:
                    self.unmeasured.append(replace(call, row=len(self.rows) - 1))


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
    nothing is left that would not use a single grasp more than ``most_per_grasp`` times. They go side by side. The
    first ``robustness.merged_grasps`` accepted ones are measured.

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
        searches[key] = _Search(key, settings, most_measured(one.task.measuring), order)
    wanted = sum(one.task.merge.grasps_per_pair for one in inputs.values())
    done = SETTLING_SHARE
    with Shared(({key: one.task for key, one in inputs.items()}, choices)) as shared:
        while searches:
            own = {key: search.calls() for key, search in searches.items()}
            for key in [key for key, calls in own.items() if not calls]:
                keep(key, pd.DataFrame(searches.pop(key).rows, columns=MERGED.names, dtype=object))
            each = [call for calls in own.values() for call in calls]
            if not each:
                continue
            share = (1 - done) * min(1.0, len(each) / max(wanted, 1))
            found = yield Calls(partial(_carry_out, shared), each, done, done + share)
            done += share
            for call, columns in zip(each, found, strict=True):
                accepted = len(searches[call.key].accepted)
                searches[call.key].record(call, columns)
                wanted -= len(searches[call.key].accepted) - accepted


def _carry_out(shared: Shared[tuple[dict[str, Task], dict[str, list[list[Settled]]]]], call: _Call) -> dict[str, Any]:
    """Return the columns that a call gives."""
    tasks, choices = shared.value
    tried = combine(
        tasks[call.key], [own[index] for own, index in zip(choices[call.key], call.combination, strict=True)]
    )
    return checked(tried) if call.row is None else measured(tried)


def summary(table: pd.DataFrame) -> str:
    """Return one line: how many combinations were accepted, and what rejected the others, most frequent first."""
    reasons = table["rejected_by"].value_counts()
    rejected = [f"{reason} {count}" for reason, count in reasons.items() if reason]
    accepted = int((table["rejected_by"] == "").sum())
    return f"{accepted} accepted of {len(table)} tried" + (f" (rejected by {', '.join(rejected)})" if rejected else "")
