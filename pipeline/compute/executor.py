"""Where calls are computed: in this process, in other processes of this machine, or on workers of a Dask cluster."""

from __future__ import annotations

import os
import pickle
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from pipeline.records.parameters.compute import ComputeParameters

# Where calls run: the section of params.yaml, or this many processes of this machine.
Workers = int | ComputeParameters

AHEAD = 2  # batches given to every worker: the one that it computes, and the next
BATCH_SECONDS = 2.0  # of work in a batch of short calls, so that sending them costs little beside computing them


class Executor(Protocol):
    """Computes batches of calls of one function; not to be used from several threads."""

    @property
    def batch_seconds(self) -> float:
        """How long a batch of several calls should take; 0 where sending calls costs nothing."""
        ...

    @property
    def sending_seconds(self) -> float:
        """What it costs the stage's process or a scheduler, whichever is slower, to send one batch."""
        ...

    def room(self) -> int:
        """Return how many batches may be under way: as many as keep every worker busy, at least 1."""
        ...

    def prepare(self, function: Callable[[Any], Any]) -> Any:
        """Return ``function`` as :meth:`submit` takes it; what it shares is with the workers until this is dropped."""
        ...

    def submit(self, key: object, prepared: Any, arguments: Sequence[Any]) -> None:
        """Begin to compute one batch; ``key`` is what :meth:`finished` calls it."""
        ...

    def finished(self) -> tuple[Any, list[Any], float]:
        """Wait for the next batch to be done, in any order; return its key, its results and the seconds that it took.

        Raises:
            WorkersLost: workers died, and with them these batches; all others are still under way.
        """
        ...

    def cancel(self) -> None:
        """Drop all batches that are under way."""
        ...


def worker_count(workers: int) -> int:
    """Return ``workers``, or the number of usable cores when it is 0."""
    return workers if workers > 0 else len(os.sched_getaffinity(0))


@dataclass(frozen=True)
class Failed:
    """What stands for the result of a call that raised an exception."""

    error: Exception
    trace: str  # the traceback where it was raised


def failure(error: Exception) -> Failed:
    """Return an exception that is being handled as one that can be sent to another process."""
    trace = traceback.format_exc()
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # it holds what cannot be sent
        error = RuntimeError(f"{type(error).__name__}: {error}")
    return Failed(error, trace)


def compute_batch(function: Callable[[Any], Any], arguments: Sequence[Any]) -> tuple[list[Any], float]:
    """Return the results of a batch of calls, :class:`Failed` for those that fail, and the seconds that they took."""
    begin = time.perf_counter()
    results: list[Any] = []
    for argument in arguments:
        try:
            results.append(function(argument))
        except Exception as error:
            results.append(failure(error))
    return results, time.perf_counter() - begin


class OwnProcess:
    """Everything in this process, one call after the other, which is easier to debug."""

    batch_seconds = sending_seconds = 0.0

    def __init__(self) -> None:
        self._waiting: list[tuple[object, Callable[[Any], Any], Sequence[Any]]] = []

    def room(self) -> int:
        """One batch: the next is chosen when this one is done."""
        return 1

    def prepare(self, function: Callable[[Any], Any]) -> Callable[[Any], Any]:
        """Return the function itself."""
        return function

    def submit(self, key: object, prepared: Callable[[Any], Any], arguments: Sequence[Any]) -> None:
        """Note what is to be computed."""
        self._waiting.append((key, prepared, arguments))

    def finished(self) -> tuple[object, list[Any], float]:
        """Compute what was noted first."""
        key, function, arguments = self._waiting.pop(0)
        return key, *compute_batch(function, arguments)

    def cancel(self) -> None:
        """Forget what was noted."""
        self._waiting.clear()
