"""Batches of calls on the workers of a Dask cluster: one of this machine, or any whose scheduler has an address.

A worker needs nothing but the same code and packages: what a call is computed from is sent to it, what comes out is
sent back, and only the stage's own process reads and writes the pipeline's files.
"""

from __future__ import annotations

import atexit
import logging
import math
import pickle
import signal
import sys
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from itertools import takewhile
from typing import Any
from weakref import WeakKeyDictionary

from pipeline.compute.executor import AHEAD, BATCH_SECONDS, compute_batch
from pipeline.compute.likeness import circumstances, difference
from pipeline.compute.losses import PATIENCE, WorkersLost
from pipeline.compute.shared import Shared
from pipeline.records.errors import UserError

ANSWER_SECONDS = 10  # for a scheduler to answer
LOOK_SECONDS = 2.0  # between looks at how many workers there are

_sent: WeakKeyDictionary[Shared[Any], Any] = WeakKeyDictionary()


@cache
def connection(address: str, workers: int) -> Any:
    """Return the client of the scheduler at ``address``, or of an own cluster of ``workers`` processes when it is ''.

    It is closed when this process ends, and so is an own cluster.

    Raises:
        UserError: Dask is not installed, or nothing answers at the address.
    """
    try:
        import dask
        import threadpoolctl  # noqa: F401  (the workers need it)
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise UserError(
            f"compute.backend is dask, but {error.name} is not installed; run `pip install -e .[cluster]`, or set "
            "compute.backend to processes."
        ) from error
    # What is wrong is said in sentences of our own; Dask's log tells every end of a worker in twenty lines.
    for name in ("distributed", "distributed.client"):  # the second has a level of its own
        logging.getLogger(name).setLevel(logging.CRITICAL)
    # Parts common to all items are sent once and may be large; there is nothing to split.
    dask.config.set({"distributed.admin.large-graph-warning-threshold": "10 GB"})
    # By Dask's 15 s, an own worker that happens to be down 15 s after it was killed would be given up.
    dask.config.set({"distributed.deploy.lost-worker-timeout": "1 day"})
    dask.config.set({"distributed.scheduler.allowed-failures": PATIENCE - 1})
    # Workers need not look every 10 ms at what they do, for a page that nobody opens.
    dask.config.set({"distributed.worker.profile.enabled": False, "distributed.admin.tick.interval": "500 ms"})
    # What is shared stays on all workers between two rounds of a search.
    dask.config.set({"distributed.scheduler.active-memory-manager.start": False})
    if not address:
        # Workers inherit this: Ctrl-C is for this process, which then ends them. While they start, it is not heard.
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            # No limit on memory: by Dask's, workers would pause or be killed long before memory ends.
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                memory_limit=0,
                dashboard_address=None,
                silence_logs=logging.CRITICAL,
            )
            client = Client(cluster)
            atexit.register(cluster.close)
        finally:
            signal.signal(signal.SIGINT, before)
    else:
        try:
            client = Client(address, timeout=ANSWER_SECONDS)
        except (OSError, ValueError) as error:
            raise UserError(
                f"no Dask scheduler answers at compute.address {address} within {ANSWER_SECONDS} s; start one there, "
                "correct the address, or set compute.backend to processes."
            ) from error
        if not client.nthreads():
            print(f"{address} has no workers yet; waiting for them (Ctrl-C ends).", file=sys.stderr)
    atexit.register(client.close)
    return client


class ClusterExecutor:
    """Batches on the workers of a cluster, whose number may change meanwhile."""

    batch_seconds = BATCH_SECONDS
    sending_seconds = 0.005

    def __init__(self, client: Any) -> None:
        from distributed import as_completed

        self._client = client
        self._keys: dict[Any, object] = {}  # by future
        self._flying = as_completed(loop=client.loop, with_results=True, raise_errors=False)
        self._expected, self._name = circumstances(), uuid.uuid4().hex
        self._submitted, self._looked, self._workers = 0, -math.inf, 0

    def room(self) -> int:
        """See :class:`~pipeline.compute.executor.Executor`; it grows with the cluster."""
        if time.monotonic() - self._looked > LOOK_SECONDS:
            self._workers, self._looked = len(self._client.nthreads()), time.monotonic()
        return AHEAD * max(self._workers, 1)

    def prepare(self, function: Callable[[Any], Any]) -> _Prepared:
        """Send what ``function`` shares to the cluster, once, and return the rest as bytes."""
        call, shared = _parts(function)
        with _scheduler_there():
            return _Prepared(_pickled(call), shared, [_on_workers(self._client, each) for each in shared])

    def submit(self, key: object, prepared: _Prepared, arguments: Sequence[Any]) -> None:
        """See :class:`~pipeline.compute.executor.Executor`."""
        self._submitted += 1
        with _scheduler_there():
            future = self._client.submit(
                _computed,
                self._expected,
                prepared.call,
                _pickled(list(arguments)),
                *prepared.futures,
                key=(self._name, self._submitted),
                pure=False,
            )
            self._keys[future] = key
            self._flying.add(future)

    def finished(self) -> tuple[object, list[Any], float]:
        """See :class:`~pipeline.compute.executor.Executor`.

        Raises:
            UserError: a worker has other code or packages, or the scheduler is gone.
        """
        from distributed import KilledWorker

        future, result = next(self._flying)
        key = self._keys.pop(future)
        try:
            with _scheduler_there():
                return key, *pickle.loads(result if future.status == "finished" else future.result())
        except KilledWorker as killed:
            raise WorkersLost([key], killed.allowed_failures + 1) from killed
        except ModuleNotFoundError as error:
            if (error.name or "").split(".")[0] != "pipeline":
                raise
            raise UserError(
                "a Dask worker does not find the package pipeline; start scheduler and workers from this checkout, "
                "with its virtual environment (docs/scaling.md)."
            ) from error

    def cancel(self) -> None:
        """Take back what is under way; the workers stay."""
        if self._client.status == "running":
            self._client.cancel(list(self._keys), force=True)
        self._keys.clear()


@dataclass(frozen=True)
class _Prepared:
    """A function for workers: what is left of it as bytes, and what it shares by the futures of its values."""

    call: bytes
    shared: tuple[Shared[Any], ...]  # held, as futures are kept by what they are of
    futures: list[Any]


@contextmanager
def _scheduler_there() -> Iterator[None]:

    from distributed.comm import CommClosedError

    try:
        yield
    except (CancelledError, CommClosedError) as error:
        raise UserError(
            "the Dask scheduler is gone, or has dropped this stage's work; start the scheduler and run the stage again."
        ) from error


def _parts(function: Callable[[Any], Any]) -> tuple[Callable[..., Any], tuple[Shared[Any], ...]]:
    """Return a function of shared values and one argument, and what is shared: a partial's leading arguments.

    A partial that shares nothing is shared as a whole: it may hold as much.
    """
    if not isinstance(function, partial):
        return function, ()
    shared = tuple(takewhile(lambda value: isinstance(value, Shared), function.args))
    if not shared:
        return _called, (Shared(function),)
    return partial(_applied, function.func, function.args[len(shared) :], function.keywords), shared


def _called(shared: Shared[Callable[[Any], Any]], argument: Any) -> Any:
    return shared.value(argument)


def _applied(
    function: Callable[..., Any], further: tuple[Any, ...], keywords: dict[str, Any], *shared_and_argument: Any
) -> Any:
    *shared, argument = shared_and_argument
    return function(*shared, *further, argument, **keywords)


def _on_workers(client: Any, shared: Shared[Any]) -> Any:
    """Return the future of a shared value: computed from its bytes, so that it comes back when its workers die.

    What Dask calls scattering is lost with them (https://github.com/dask/distributed/issues/3149).
    """
    if shared not in _sent:
        future = client.submit(pickle.loads, _pickled(shared.value), key=f"shared-{uuid.uuid4().hex}", pure=False)
        shared.at_end(future.release)
        _sent[shared] = future
    return _sent[shared]


def _pickled(value: object) -> bytes:
    """Return bytes that only a worker reads: the scheduler would load physics to look at the items in passing."""
    import cloudpickle  # takes functions of a script, too

    return cloudpickle.dumps(value)


def _computed(expected: dict[str, str], call: bytes, arguments: bytes, *shared: Any) -> bytes:
    """Compute a batch on a worker and return what :func:`compute_batch` returns, pickled.

    Raises:
        UserError: the worker would not compute the same bytes.
    """
    _check_worker(tuple(expected.items()))
    function = partial(pickle.loads(call), *map(Shared, shared))
    return pickle.dumps(compute_batch(function, pickle.loads(arguments)), protocol=pickle.HIGHEST_PROTOCOL)


@lru_cache(maxsize=8)
def _check_worker(expected: tuple[tuple[str, str], ...]) -> None:
    """Refuse to compute on an unlike worker, and let numpy, which Dask may have loaded already, use one thread."""
    import threadpoolctl
    from distributed import get_worker

    worker = get_worker()
    if found := difference(dict(expected)):
        raise UserError(
            f"the Dask worker {worker.address} would not compute the same bytes: {found}; bring its machine to the "
            "same state and start its workers again."
        )
    if worker.state.nthreads != 1:
        raise UserError(
            f"the Dask worker {worker.address} has {worker.state.nthreads} threads, and physics takes one; start "
            "workers with --nthreads 1, and more of them."
        )
    threadpoolctl.threadpool_limits(1)
