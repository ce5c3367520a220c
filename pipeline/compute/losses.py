"""What to do when a process that computes is killed: its items run again, until one is known to kill whoever has it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TypeVar

from pipeline.records.errors import UserError

Result = TypeVar("Result")

# Deaths of processes before suspects run alone, and of processes that ran one item alone before it is given up. A
# process may also die of something else: memory that others use, or a person.
PATIENCE = 3


class WorkersLost(Exception):
    """Processes died, and these items had been given to them; everything else is done or has not begun."""

    def __init__(self, suspects: Sequence[int], deaths: int) -> None:
        """Tell the suspects, and how many processes died of them."""
        super().__init__(suspects, deaths)
        self.suspects, self.deaths = suspects, deaths


def until_all_done(
    run: Callable[[Sequence[int]], Iterable[tuple[int, Result]]], count: int, label: str
) -> Iterator[tuple[int, Result]]:
    """Yield numbers and results of all of ``count`` items, in any order, whatever processes die meanwhile.

    Args:
        run: computes the items of these numbers; raises :class:`WorkersLost` when processes have died.

    Raises:
        UserError: an item ended every process that computed it, the last times with no other item beside it.
    """
    missing = dict.fromkeys(range(count))

    def some(numbers: Sequence[int]) -> Iterator[tuple[int, Result]]:
        for number, result in run(numbers):
            del missing[number]
            yield number, result

    deaths = 0
    while missing:
        try:
            yield from some(list(missing))
        except WorkersLost as lost:
            deaths += lost.deaths
            if deaths >= PATIENCE:
                for number in lost.suspects:
                    yield from _alone(some, number, f"{label}: item {number + 1} of {count}")
                deaths = 0


def _alone(
    some: Callable[[Sequence[int]], Iterator[tuple[int, Result]]], number: int, name: str
) -> Iterator[tuple[int, Result]]:
    deaths = 0
    while True:
        try:
            yield from some([number])
            return
        except WorkersLost as lost:
            deaths += lost.deaths
        if deaths >= PATIENCE:
            raise UserError(
                f"{name} ended {deaths} processes that computed it and nothing else (too little memory?); set "
                "compute.backend to processes and compute.workers to 1 to see how it ends."
            )
