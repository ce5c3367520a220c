"""Apply a function to many independent items in parallel, with a progress bar and results in the order of the items."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import TypeVar

from pipeline.compute.progress import watched

Item = TypeVar("Item")
Result = TypeVar("Result")


def worker_count(workers: int) -> int:
    """Return ``workers``, or the number of usable cores when it is 0."""
    return workers if workers > 0 else len(os.sched_getaffinity(0))


def fan_out(function: Callable[[Item], Result], items: Sequence[Item], workers: int, label: str) -> list[Result]:
    """Return ``[function(item) for item in items]``, computed by ``workers`` processes (0: one per core).

    The result must not depend on the number of workers: seed every item by what it is (``records.seeds``). With one
    worker everything runs in this process, which is easier to debug. ``function`` must be picklable (module level).
    """
    count = min(worker_count(workers), max(len(items), 1))
    if count == 1:
        return list(watched(map(function, items), len(items), label))
    from joblib import Parallel, delayed

    parallel = Parallel(n_jobs=count, return_as="generator", batch_size=1)
    return list(watched(parallel(delayed(function)(item) for item in items), len(items), label))
