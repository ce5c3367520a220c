"""Apply a function to many independent items in parallel, with a progress bar and results in the order of the items."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

from pipeline.compute.losses import until_all_done
from pipeline.compute.progress import watched
from pipeline.records.parameters.compute import ComputeParameters

Item = TypeVar("Item")
Result = TypeVar("Result")

# Where items run: the section of params.yaml, or this many processes of this machine.
Workers = int | ComputeParameters


def worker_count(workers: int) -> int:
    """Return ``workers``, or the number of usable cores when it is 0."""
    return workers if workers > 0 else len(os.sched_getaffinity(0))


def fan_out(function: Callable[[Item], Result], items: Sequence[Item], workers: Workers, label: str) -> list[Result]:
    """Return ``[function(item) for item in items]``, computed where ``workers`` says.

    The result must not depend on where: seed every item by what it is (``records.seeds``), and let ``function`` neither
    read nor write files of the pipeline, which a worker on another machine does not have. With one process everything
    runs in this one, which is easier to debug. ``function`` must be picklable (module level).

    Items of a process that is killed run again in another.

    Raises:
        UserError: an item ends every process that computes it, or the cluster cannot be used.
    """
    compute = (
        workers
        if isinstance(workers, ComputeParameters)
        else ComputeParameters(backend="processes", address="", workers=workers)
    )
    count = min(worker_count(compute.workers), max(len(items), 1))
    if not items:
        return []
    if compute.backend == "processes" and count == 1:
        return list(watched(map(function, items), len(items), label))
    if compute.backend == "dask":
        from pipeline.compute.cluster import connection, run_on_cluster

        client = connection(compute.address, worker_count(compute.workers))

        def run(numbers: Sequence[int]) -> Iterable[tuple[int, Result]]:
            return run_on_cluster(function, items, numbers, client, label)

    else:
        from pipeline.compute.processes import run_in_processes

        def run(numbers: Sequence[int]) -> Iterable[tuple[int, Result]]:
            return run_in_processes(function, items, numbers, count)

    results = dict(watched(until_all_done(run, len(items), label), len(items), label))
    return [results[number] for number in range(len(items))]
