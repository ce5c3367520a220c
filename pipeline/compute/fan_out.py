"""Apply a function to many independent items in parallel, with a progress bar and results in the order of the items."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

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
    from tqdm import tqdm

    def progress(results: Iterable[Result]) -> list[Result]:
        return list(tqdm(results, total=len(items), desc=label, file=sys.stderr, mininterval=1.0))

    count = min(worker_count(workers), max(len(items), 1))
    if count == 1:
        return progress(function(item) for item in items)
    from joblib import Parallel, delayed

    parallel = Parallel(n_jobs=count, return_as="generator", batch_size=1)
    return progress(parallel(delayed(function)(item) for item in items))
