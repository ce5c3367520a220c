"""Trials as items of a stage: each is computed by itself, with its objects sent to a worker once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import cache, lru_cache, partial

import pandas as pd

from pipeline.compute.pool import Calls, Work
from pipeline.compute.shared import Shared
from pipeline.evaluate.trial import TrialInput, run_trial_with
from pipeline.records.objects import PreparedObject
from pipeline.stages.items import Begin, Keep
from pipeline.stages.outputs import Tables


@contextmanager
def trials_of(tables: Tables, inputs_of: Callable[[str], Sequence[TrialInput]]) -> Iterator[Begin]:
    """Yield what begins trials by their keys.

    Args:
        tables: for their rows.
        inputs_of: returns the inputs of all trials with the same objects; called with a key without its last part, the
            number.
    """
    with ExitStack() as until_all_done:
        cached = lru_cache(maxsize=2)(inputs_of)

        @cache
        def shared_objects(objects: str) -> Shared[tuple[PreparedObject, ...]]:
            return until_all_done.enter_context(Shared(cached(objects)[0].objects))

        def work(key: str, keep: Keep) -> Work[None]:
            objects, _, number = key.rpartition("/")
            trial = next(trial for trial in cached(objects) if trial.trial == int(number))
            (row,) = yield Calls(partial(run_trial_with, shared_objects(objects)), [replace(trial, objects=())])
            keep(key, tables.rows(pd.DataFrame([row])))

        yield lambda keys, keep: [(key, partial(work, key, keep)) for key in keys]
