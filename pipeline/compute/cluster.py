"""Items on the workers of a Dask cluster: one of this machine, or any whose scheduler has an address.

A worker needs nothing but the same code and packages: what an item is computed from is sent to it, what comes out is
sent back, and only the stage's own process reads and writes the pipeline's files.
"""

from __future__ import annotations

import atexit
import logging
import pickle
import signal
import sys
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from functools import cache, lru_cache, partial
from itertools import islice
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

from pipeline.compute.likeness import circumstances, difference
from pipeline.compute.losses import PATIENCE, WorkersLost
from pipeline.compute.shared import Shared
from pipeline.records.errors import UserError

Item = TypeVar("Item")
Result = TypeVar("Result")

ANSWER_SECONDS = 10  # for a scheduler to answer
AHEAD = 2  # items given to every worker: the one that it computes, and the next
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
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
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


def run_on_cluster(
    function: Callable[[Item], Result], items: Sequence[Item], numbers: Sequence[int], client: Any, label: str
) -> Iterator[tuple[int, Result]]:
    """Yield numbers and results of the items with these numbers, as they are done.

    Raises:
        WorkersLost: items whose workers died again and again, when all others are done.
        UserError: a worker has other code or packages, or the scheduler is gone.
    """
    from concurrent.futures import CancelledError

    from distributed.comm import CommClosedError

    try:
        yield from _as_done(function, items, numbers, client, label)
    except (CancelledError, CommClosedError) as error:
        raise UserError(
            "the Dask scheduler is gone, or has dropped this stage's work; start the scheduler and run the stage again."
        ) from error


def _as_done(
    function: Callable[[Item], Result], items: Sequence[Item], numbers: Sequence[int], client: Any, label: str
) -> Iterator[tuple[int, Result]]:
    from distributed import as_completed

    call, common = _common_part(function)
    task = partial(_computed, circumstances(), _pickled(call))
    name, todo, flying = f"{label}-{uuid.uuid4().hex[:8]}", iter(numbers), as_completed()
    known: dict[Any, int] = {}
    suspects: list[int] = []
    deaths, looked, room = 0, 0.0, 0
    with_common = _on_workers(client, common)

    def give() -> None:
        for number in islice(todo, max(room - len(known), 0)):
            future = client.submit(task, with_common, _pickled(items[number]), key=(name, number), pure=False)
            known[future] = number
            flying.add(future)

    try:
        room = AHEAD * max(len(client.nthreads()), 1)
        give()
        for future in flying:
            number = known.pop(future)
            try:
                yield number, pickle.loads(_outcome(future))
            except WorkersLost as lost:
                suspects.append(number)
                deaths = max(deaths, lost.deaths)
            if time.monotonic() - looked > LOOK_SECONDS:
                room, looked = AHEAD * max(len(client.nthreads()), 1), time.monotonic()
            give()
    finally:
        if known and client.status == "running":
            client.cancel(list(known), force=True)
    if suspects:
        raise WorkersLost(suspects, deaths)


def _outcome(future: Any) -> bytes:
    """Return what the worker sent.

    Raises:
        WorkersLost: the item's workers died again and again.
        UserError: a worker has other code or packages.
        Exception: whatever the item raised.
    """
    from distributed import KilledWorker

    try:
        return future.result()
    except KilledWorker as killed:
        raise WorkersLost([], killed.allowed_failures + 1) from killed
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] != "pipeline":
            raise
        raise UserError(
            "a Dask worker does not find the package pipeline; start scheduler and workers from this checkout, with "
            "its virtual environment (docs/scaling.md)."
        ) from error


def _common_part(function: Callable[[Item], Result]) -> tuple[Callable[[Shared[Any], Item], Result], Shared[Any]]:
    """Return a function as one of what all its items share and of the item."""
    if isinstance(function, partial) and len(function.args) == 1 and isinstance(function.args[0], Shared):
        return partial(function.func, **function.keywords), function.args[0]
    return _called, Shared(function)


def _called(shared: Shared[Callable[[Item], Result]], item: Item) -> Result:
    return shared.value(item)


def _on_workers(client: Any, shared: Shared[Any]) -> Any:
    """Return the future of a shared value: computed from its bytes, so that it comes back when its workers die.

    What Dask calls scattering is lost with them (https://github.com/dask/distributed/issues/3149).
    """
    if shared not in _sent:
        content = _pickled(shared.value)
        _sent[shared] = client.submit(pickle.loads, content, key=f"shared-{uuid.uuid4().hex}", pure=False)
    return _sent[shared]


def _pickled(value: object) -> bytes:
    """Return bytes that only a worker reads: the scheduler would load physics to look at the items in passing."""
    import cloudpickle  # takes functions of a script, too

    return cloudpickle.dumps(value)


def _computed(expected: dict[str, str], call: bytes, common: Any, item: bytes) -> bytes:
    """Compute one item on a worker and return the pickled result.

    Raises:
        UserError: the worker would not compute the same bytes.
    """
    _check_worker(tuple(expected.items()))
    return pickle.dumps(pickle.loads(call)(Shared(common), pickle.loads(item)), protocol=pickle.HIGHEST_PROTOCOL)


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
