"""Items in processes of this machine."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

from pipeline.compute.losses import WorkersLost

Item = TypeVar("Item")
Result = TypeVar("Result")

AHEAD = 2  # items given to every process: the one that it computes, and the next


def run_in_processes(
    function: Callable[[Item], Result], items: Sequence[Item], numbers: Sequence[int], count: int
) -> Iterator[tuple[int, Result]]:
    """Yield numbers and results of the items with these numbers, as they are done, from ``count`` processes.

    Raises:
        WorkersLost: a process died. Items are given out in order, so that the suspects are the first without result.
    """
    from joblib import Parallel, delayed
    from joblib.externals.loky import BrokenProcessPool

    # A process of its own even for one item: it may be one that kills.
    parallel = Parallel(
        n_jobs=max(count, 2), return_as="generator_unordered", batch_size=1, pre_dispatch=f"{AHEAD} * n_jobs"
    )
    missing = dict.fromkeys(numbers)
    try:
        for number, result in parallel(delayed(_numbered)(function, number, items[number]) for number in numbers):
            del missing[number]
            yield number, result
    except BrokenProcessPool as error:
        raise WorkersLost(list(missing)[: AHEAD * max(count, 2)], deaths=1) from error


def _numbered(function: Callable[[Item], Result], number: int, item: Item) -> tuple[int, Result]:
    return number, function(item)
