"""Batches of calls in processes of this machine."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Sequence
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from pipeline.compute.executor import AHEAD, BATCH_SECONDS, compute_batch
from pipeline.compute.losses import WorkersLost

IDLE_SECONDS = 300  # after which a process ends that has nothing to do: the stage may be between two searches


class Processes:
    """As many processes as given, which stay for whoever asks next; made anew when one has died."""

    batch_seconds = BATCH_SECONDS
    sending_seconds = 0.0005

    def __init__(self, count: int) -> None:
        self._count = count
        self._loky = _started(count)
        self._flying: dict[Any, object] = {}  # keys by future
        self._done: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def room(self) -> int:
        """See :class:`~pipeline.compute.executor.Executor`."""
        return AHEAD * self._count

    def prepare(self, function: Callable[[Any], Any]) -> Callable[[Any], Any]:
        """Return the function itself: it goes with every batch, and what it shares through a file."""
        return function

    def submit(self, key: object, prepared: Callable[[Any], Any], arguments: Sequence[Any]) -> None:
        """See :class:`~pipeline.compute.executor.Executor`."""
        try:
            future = self._loky.submit(compute_batch, prepared, arguments)
        except BrokenProcessPool:
            self._loky = _started(self._count)
            future = self._loky.submit(compute_batch, prepared, arguments)
        self._flying[future] = key
        future.add_done_callback(self._done.put)

    def finished(self) -> tuple[object, list[Any], float]:
        """See :class:`~pipeline.compute.executor.Executor`; a death loses all batches that are not done."""
        future = self._done.get()
        key = self._flying.pop(future)
        try:
            return key, *future.result()
        except BrokenProcessPool as error:
            raise self._lost(key) from error

    def _lost(self, key: object) -> WorkersLost:
        lost, done = [key], []
        for _ in range(len(self._flying)):
            future = self._done.get()  # all end now
            if isinstance(future.exception(), BrokenProcessPool):
                lost.append(self._flying.pop(future))
            else:
                done.append(future)
        for future in done:
            self._done.put(future)
        return WorkersLost(lost, deaths=1)

    def cancel(self) -> None:
        """End the processes with what they compute."""
        # Loky fails in a thread of its own when it is ended before it has taken what was submitted.
        while any(not future.running() and not future.done() for future in self._flying):
            time.sleep(0.001)
        self._flying.clear()
        self._loky.shutdown(kill_workers=True)


def _started(count: int) -> Any:
    """Return the processes of this process; loky makes them anew where some have died."""
    from joblib.externals.loky import get_reusable_executor

    return get_reusable_executor(max_workers=count, timeout=IDLE_SECONDS)
