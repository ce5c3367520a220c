"""Many items at the same time, each of which is rounds of calls: one pool that all items of a stage share."""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Generic, TypeVar

from pipeline.compute.cluster import ClusterExecutor, connection
from pipeline.compute.executor import Executor, Failed, OwnProcess, Workers, failure, worker_count
from pipeline.compute.losses import GivenUp, Losses, WorkersLost
from pipeline.compute.processes import Processes
from pipeline.compute.progress import Bar
from pipeline.records.parameters.compute import ComputeParameters

Result = TypeVar("Result")

FORGETTING = 0.9  # weight of what was known of a function's seconds, beside one more batch of it


@dataclass(frozen=True)
class Calls(Generic[Result]):
    """A round of independent calls of one function, one for each of ``arguments``.

    ``function`` is of module level, or a ``functools.partial`` of one. What many calls read, put into partial's leading
    arguments as :class:`~pipeline.compute.shared.Shared`: a worker gets it once.

    ``begin`` and ``end`` are the shares of the item's work that are done before and after these calls, for the bar.
    """

    function: Callable[[Any], Result]
    arguments: Sequence[Any]
    begin: float = 0.0
    end: float = 1.0


# An item in progress: yields rounds of calls, is sent their results in order, and returns the result of the item.
Work = Generator[Calls[Any], list[Any], Result]
# Takes the key of an item that failed, and why. What it raises itself ends everything.
OnFailure = Callable[[str, Failed], None]


def run_all(
    works: Sequence[tuple[str, Callable[[], Work[Any]]]],
    workers: Workers,
    label: str,
    done: Callable[[str, Any], None],
    failed: OnFailure | None = None,
) -> None:
    """Run all items where ``workers`` says, with one progress bar for all.

    Results must not depend on where calls run, nor beside which others: seed every call by what it is
    (``records.seeds``), and let functions neither read nor write files of the pipeline, which a worker on another
    machine does not have.

    Calls of a process that is killed run again in another.

    Args:
        works: keys of items and what begins each. They are begun in this order (give the longest first), each only when
            those before it leave workers without calls; whatever they do between their rounds is done in this process.
        workers: where calls run.
        label: of the progress bar.
        done: is given the key and the result of every item as soon as it is finished, in any order, in this process.
        failed: is given the key of every item that raises an exception, one of whose calls does, or one of whose calls
            ends every process that computes it; all other items go on.

    Raises:
        UserError: the cluster cannot be used.
        Exception: without ``failed``: whatever an item or one of its calls raised first; nothing goes on after that.
    """
    if works:
        run_on(_executor_of(workers), works, label, done, failed)


def run_one(work: Work[Result], workers: Workers, label: str) -> Result:
    """Run one item, and return its result; see :func:`run_all`."""
    results: list[Result] = []
    run_all([(label, lambda: work)], workers, label, lambda _, result: results.append(result))
    return results[0]


def run_on(
    executor: Executor,
    works: Sequence[tuple[str, Callable[[], Work[Any]]]],
    label: str,
    done: Callable[[str, Any], None],
    failed: OnFailure | None = None,
) -> None:
    """Run all items on an executor; see :func:`run_all`."""
    with Bar(len(works), label) as bar:
        pool = _Pool(executor, works, done, bar, failed)
        try:
            pool.run()
        finally:
            pool.close()


@dataclass(eq=False)
class _Round:
    """A round of calls of one item that is under way."""

    work: int
    key: str
    calls: Calls[Any]
    prepared: Any
    results: dict[int, Any] = field(default_factory=dict)

    @property
    def share(self) -> float:
        """How much of the item's work is done."""
        return self.calls.begin + (self.calls.end - self.calls.begin) * len(self.results) / len(self.calls.arguments)


@dataclass(eq=False)
class _Batch:
    """Calls of the same function that are sent together: the round and the number of each."""

    calls: list[tuple[_Round, int]]

    def split(self) -> list[_Batch]:
        """Return every call as a batch of its own; the same batch when it is one already."""
        return [_Batch([call]) for call in self.calls] if len(self.calls) > 1 else [self]

    def name(self) -> str:
        """How the first of the calls is called in a sentence."""
        begun, number = self.calls[0]
        return f"{begun.key}: call {number + 1} of {len(begun.calls.arguments)}"


class _Pool:
    def __init__(
        self,
        executor: Executor,
        works: Sequence[tuple[str, Callable[[], Work[Any]]]],
        done: Callable[[str, Any], None],
        bar: Bar,
        failed: OnFailure | None,
    ) -> None:
        self._executor, self._works, self._done, self._bar, self._failed = executor, works, done, bar, failed
        self._begun = 0
        self._open: dict[int, Work[Any]] = {}
        # Calls that wait, those of earlier items first: number of the item, of the call, and the call's round.
        self._ready: list[tuple[int, int, _Round]] = []
        self._flying: set[_Batch] = set()
        self._losses: Losses[_Batch] = Losses(_Batch.split, _Batch.name)
        self._pace: defaultdict[object, _Pace] = defaultdict(_Pace)

    def run(self) -> None:
        """Run until every item is finished."""
        while self._give():
            try:
                batch, results, seconds = self._executor.finished()
            except WorkersLost as lost:
                batches: list[_Batch] = list(lost.batches)  # type: ignore[arg-type]
                self._flying.difference_update(batches)
                self._compute_again(batches, lost.deaths)
            else:
                self._record(batch, results, seconds)

    def _compute_again(self, batches: list[_Batch], deaths: int) -> None:
        """Let calls wait again whose processes died; give up an item that ends every process."""
        try:
            again = self._losses.lost(batches, deaths)
        except GivenUp as error:
            assert isinstance(error.batch, _Batch)
            self._fail(error.batch.calls[0][0].work, failure(error))
        else:
            for batch in again:
                for begun, number in batch.calls:
                    self._wait(begun, [number])

    def _fail(self, work: int, failed: Failed) -> None:
        """Give up an item, or everything if nobody wants to know of failures."""
        if self._failed is None:
            raise failed.error from _Elsewhere(failed.trace)
        if work in self._open:
            self._open.pop(work).close()
            self._ready = [entry for entry in self._ready if entry[0] != work]
            heapq.heapify(self._ready)
            self._failed(self._works[work][0], failed)
            self._bar.finished(work)

    def close(self) -> None:
        """Drop what is still under way, after an error."""
        if self._flying:
            self._executor.cancel()
        for work in self._open.values():
            work.close()

    def _give(self) -> bool:
        """Give the executor what it has room for; return whether anything is under way."""
        if self._losses.suspecting:
            if not self._flying:
                self._submit(self._losses.next_alone())
            return True
        room = self._executor.room()
        while len(self._flying) < room:
            while len(self._ready) < room and self._begun < len(self._works):
                self._begin()
            if not self._ready:
                break
            self._submit(self._next_batch(room))
        return bool(self._flying)

    def _begin(self) -> None:
        work, (_, begin) = self._begun, self._works[self._begun]
        self._begun += 1
        try:
            self._open[work] = begin()
        except Exception as error:
            self._open[work] = _nothing()
            self._fail(work, failure(error))
        else:
            self._advance(work, None)

    def _advance(self, work: int, results: list[Any] | None) -> None:
        """Let an item go on to its next round that has calls, or to its end."""
        key = self._works[work][0]
        try:
            # A generator that has not begun takes None alone.
            calls = self._open[work].send(results)  # type: ignore[arg-type]
            while not len(calls.arguments):
                calls = self._open[work].send([])
        except StopIteration as end:
            del self._open[work]
            self._done(key, end.value)
            self._bar.finished(work)
        except Exception as error:
            self._fail(work, failure(error))
        else:
            self._bar.moved(work, calls.begin)
            begun = _Round(work, key, calls, self._executor.prepare(calls.function))
            self._wait(begun, range(len(calls.arguments)))

    def _wait(self, begun: _Round, numbers: Sequence[int]) -> None:
        for number in numbers:
            heapq.heappush(self._ready, (begun.work, number, begun))

    def _next_batch(self, room: int) -> _Batch:
        """Take the first call that waits, and others of the same function when calls are short."""
        begun = self._ready[0][2]
        pace = self._pace[_called(begun.calls.function)]
        most = pace.calls_in(self._executor.batch_seconds)
        if self._begun == len(self._works):
            # So that all workers end at about the same time, but none waits because there is so much to send.
            most = min(most, max(len(self._ready) // room, pace.calls_in(room * self._executor.sending_seconds)))
        calls: list[tuple[_Round, int]] = []
        while self._ready and len(calls) < most and _same(self._ready[0][2].calls.function, begun.calls.function):
            _, number, own = heapq.heappop(self._ready)
            calls.append((own, number))
        return _Batch(calls)

    def _submit(self, batch: _Batch) -> None:
        self._flying.add(batch)
        arguments = [begun.calls.arguments[number] for begun, number in batch.calls]
        self._executor.submit(batch, batch.calls[0][0].prepared, arguments)

    def _record(self, batch: _Batch, results: list[Any], seconds: float) -> None:
        self._flying.remove(batch)
        self._losses.finished(batch)
        self._pace[_called(batch.calls[0][0].calls.function)].add(len(results), seconds)
        for (begun, number), result in zip(batch.calls, results, strict=True):
            if isinstance(result, Failed):
                self._fail(begun.work, result)
            begun.results[number] = result
        for begun in dict.fromkeys(begun for begun, _ in batch.calls if begun.work in self._open):
            if len(begun.results) < len(begun.calls.arguments):
                self._bar.moved(begun.work, begun.share)
            else:
                self._advance(begun.work, [begun.results[number] for number in range(len(begun.calls.arguments))])


class _Elsewhere(Exception):
    """The traceback of an exception in another process, as the cause of the same exception here."""


def _nothing() -> Work[None]:
    """Return the work of an item that could not be begun."""
    yield from ()


@dataclass
class _Pace:
    """How long calls of a function take, as far as it is known."""

    calls: float = 0.0
    seconds: float = 0.0

    def add(self, calls: int, seconds: float) -> None:
        """Learn from one more batch; the first, which also load what they need, are forgotten by and by."""
        self.calls = FORGETTING * self.calls + calls
        self.seconds = FORGETTING * self.seconds + seconds

    def calls_in(self, seconds: float) -> int:
        """Return how many calls take about this long, at least 1; 1 while nothing is known."""
        if not self.calls:
            return 1
        return max(1, int(seconds * self.calls / max(self.seconds, 1e-6)))


def _called(function: Callable[[Any], Any]) -> object:
    """Return what a function is, whatever it has been given already."""
    return function.func if isinstance(function, partial) else function


def _same(one: Callable[[Any], Any], other: Callable[[Any], Any]) -> bool:
    """Return whether two functions are the same, with the same shared values."""
    if not (isinstance(one, partial) and isinstance(other, partial)):
        return one is other
    given = [(*each.args, *each.keywords.values()) for each in (one, other)]
    same = len(given[0]) == len(given[1]) and all(a is b for a, b in zip(*given, strict=True))
    return one.func is other.func and one.keywords.keys() == other.keywords.keys() and same


def _executor_of(workers: Workers) -> Executor:
    """Return the executor that ``workers`` asks for.

    Raises:
        UserError: the cluster cannot be used.
    """
    compute = (
        workers
        if isinstance(workers, ComputeParameters)
        else ComputeParameters(backend="processes", address="", workers=workers)
    )
    count = worker_count(compute.workers)
    if compute.backend == "dask":
        return ClusterExecutor(connection(compute.address, count))
    return OwnProcess() if count == 1 else Processes(count)
