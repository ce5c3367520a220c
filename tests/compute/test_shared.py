"""What many tasks read is sent to a process once."""

import gc
import pickle
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.compute.fan_out import fan_out
from pipeline.compute.shared import KEPT, Shared
from tests.compute.items import total, weighted


def test_every_process_reads_it_once() -> None:
    with Shared(np.arange(1000.0)) as shared:
        results = fan_out(partial(total, shared), list(range(8)), 2, "totals")
    assert [value for value, *_ in results] == [499500.0 * factor for factor in range(8)]
    assert len({(identity, process) for _, identity, process, _ in results}) == len({p for _, _, p, _ in results})


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


def test_several_values_and_further_arguments() -> None:
    with Shared(np.arange(4.0)) as first, Shared(np.ones(3)) as second:
        function = partial(weighted, first, second, 0.5, sign=-1)
        for workers in (1, 2):
            assert fan_out(function, [0, 1, 2], workers, "weighted") == [-5.5, -8.5, -11.5]


def held(shared: Shared, _: int) -> int:
    """Read what is shared, and return how many values like it this process has."""
    assert shared.value.array.shape == (3, 5, 7, 11)
    return sum(isinstance(each, Odd) for each in gc.get_objects())


class Odd:
    """Something that the garbage collector knows, as it does objects."""

    def __init__(self) -> None:
        self.array = np.zeros((3, 5, 7, 11))


def test_a_worker_holds_the_last_few_values_alone() -> None:
    counts = []
    for _ in range(KEPT + 4):
        with Shared(Odd()) as shared:
            counts += fan_out(partial(held, shared), [0, 1], 2, "held")
    assert max(counts) <= KEPT + 1  # and one that goes while the next is read
