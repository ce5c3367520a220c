"""Apply a function to many independent arguments in parallel, with a progress bar and results in their order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from pipeline.compute.executor import Workers, worker_count
from pipeline.compute.pool import Calls, Work, run_one
from pipeline.records.parameters.compute import ComputeParameters

Item = TypeVar("Item")
Result = TypeVar("Result")


def fan_out(function: Callable[[Item], Result], items: Sequence[Item], workers: Workers, label: str) -> list[Result]:
    """Return ``[function(item) for item in items]``, computed where ``workers`` says.

    What :func:`~pipeline.compute.pool.run_all` asks of calls holds for ``function``. With one process everything runs
    in this one, which is easier to debug.

    Raises:
        UserError: an item ends every process that computes it, or the cluster cannot be used.
    """
    if not items:
        return []
    if not isinstance(workers, ComputeParameters):
        workers = ComputeParameters(backend="processes", address="", workers=workers)
    if workers.backend == "processes":
        workers = workers.model_copy(update={"workers": min(worker_count(workers.workers), len(items))})

    def work() -> Work[list[Result]]:
        return (yield Calls(function, items))

    return run_one(work(), workers, label)
