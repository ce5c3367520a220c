"""What many tasks read is sent to a process once."""

import os
import pickle
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.compute.fan_out import fan_out
from pipeline.compute.shared import Shared


def total(shared: Shared, factor: int) -> tuple[float, int, int]:
    values = shared.value
    return float(values.sum() * factor), id(values), os.getpid()


def test_every_process_reads_it_once() -> None:
    with Shared(np.arange(1000.0)) as shared:
        results = fan_out(partial(total, shared), list(range(8)), 2, "totals")
    assert [value for value, _, _ in results] == [499500.0 * factor for factor in range(8)]
    assert len({(identity, process) for _, identity, process in results}) == len({p for _, _, p in results})


def test_with_one_worker_nothing_is_copied(monkeypatch) -> None:
    monkeypatch.setattr("tempfile.mkdtemp", lambda **_: 1 / 0)
    values = np.arange(3.0)
    with Shared(values) as shared:
        assert fan_out(partial(total, shared), [1, 2], 1, "totals")[1][1] == id(values)


def test_a_task_stays_small_and_the_file_goes() -> None:
    with Shared(np.zeros(100_000)) as shared:
        sent = pickle.dumps(shared)
        assert len(sent) < 1000
        again = pickle.loads(sent)
        assert again.value.shape == (100_000,) and pickle.dumps(shared) == sent
        folder = Path(again._folder)
        assert folder.exists()
    assert not folder.exists()
