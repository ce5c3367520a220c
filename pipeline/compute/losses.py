"""What to do when a process that computes is killed: its calls run again, until one is known to kill whoever has it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Hashable, Sequence
from typing import Generic, TypeVar

from pipeline.records.errors import UserError

Batch = TypeVar("Batch", bound=Hashable)

# Deaths of processes before suspects run alone, and of processes that ran one call alone before it is given up. A
# process may also die of something else: memory that others use, or a person.
PATIENCE = 3


class WorkersLost(Exception):
    """Processes died, and these batches with them; every other batch is done or still under way."""

    def __init__(self, batches: Sequence[Hashable], deaths: int) -> None:
        """Tell the batches, and how many processes died of them."""
        super().__init__(batches, deaths)
        self.batches, self.deaths = batches, deaths


class GivenUp(UserError):
    """A call has ended every process that computed it."""

    def __init__(self, batch: Hashable, sentence: str) -> None:
        """Tell the call, as a batch of its own, and what is to be said."""
        super().__init__(sentence)
        self.batch = batch


class Losses(Generic[Batch]):
    """Decides what lost batches do next: run again beside others, run alone, or end the stage.

    Args:
        split: returns a batch as batches of one call each.
        name: how a batch of one call is called in the sentence that ends the stage.
    """

    def __init__(self, split: Callable[[Batch], list[Batch]], name: Callable[[Batch], str]) -> None:
        self._split, self._name = split, name
        self._deaths = 0
        self._suspects: deque[Batch] = deque()
        self._alone: Batch | None = None
        self._deaths_alone: dict[Batch, int] = {}

    @property
    def suspecting(self) -> bool:
        """Whether there are batches that must run alone before all others go on."""
        return bool(self._suspects) or self._alone is not None

    def next_alone(self) -> Batch:
        """Return the next batch to run with no other beside it."""
        self._alone = self._suspects.popleft()
        return self._alone

    def finished(self, batch: Batch) -> None:
        """Note that a batch is done."""
        if batch is self._alone:
            self._alone = None

    def lost(self, batches: Sequence[Batch], deaths: int) -> list[Batch]:
        """Return which lost batches are to run again beside others; the rest are suspects now.

        Raises:
            GivenUp: a call has ended :data:`PATIENCE` processes that computed it and nothing else.
        """
        if self._alone is not None:
            self._lost_alone(self._alone, deaths)
            return []
        self._deaths += deaths
        if self._deaths < PATIENCE:
            return list(batches)
        self._suspects.extend(batches)
        self._deaths = 0
        return []

    def _lost_alone(self, batch: Batch, deaths: int) -> None:
        self._alone = None
        if len(calls := self._split(batch)) > 1:
            self._suspects.extendleft(reversed(calls))
            return
        self._deaths_alone[batch] = self._deaths_alone.get(batch, 0) + deaths
        if self._deaths_alone[batch] >= PATIENCE:
            raise GivenUp(
                batch,
                f"{self._name(batch)} ended {self._deaths_alone[batch]} processes that computed it and nothing else "
                "(too little memory?); set compute.backend to processes and compute.workers to 1 to see how it ends.",
            )
        self._suspects.appendleft(batch)
