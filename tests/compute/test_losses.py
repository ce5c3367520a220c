"""A process that is killed in the middle loses no work, on either backend."""

import os
import signal
from functools import partial
from pathlib import Path

import pytest

from pipeline.compute.fan_out import fan_out
from pipeline.compute.losses import WorkersLost, until_all_done
from pipeline.records.errors import UserError
from pipeline.records.parameters.compute import ComputeParameters

pytest.importorskip("distributed", reason="needs the extra `cluster`")

PROCESSES = ComputeParameters(backend="processes", workers=2)
DASK = ComputeParameters(backend="dask", workers=2)


def killed_once(folder: Path, number: int) -> int:
    """Kill the process that computes item 3, the first time; say who computed what."""
    with open(folder / f"{number}", "a") as log:
        log.write(f"{os.getpid()}\n")
    if number == 3 and len((folder / "3").read_text().split()) == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def killed_always(number: int) -> int:
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


@pytest.mark.parametrize("compute", [PROCESSES, DASK], ids=["processes", "dask"])
def test_a_killed_worker_loses_no_work(compute, tmp_path):
    items = list(range(12))
    assert fan_out(partial(killed_once, tmp_path), items, compute, "killed once") == [item * item for item in items]
    tries = {item: (tmp_path / f"{item}").read_text().split() for item in items}
    assert len(set(tries[3])) == 2  # in another process
    # What had been done is not done again, but for what was under way or, with Dask, still in the killed worker.
    assert sum(map(len, tries.values())) <= len(items) + 4


@pytest.mark.slow
@pytest.mark.parametrize("compute", [PROCESSES, DASK], ids=["processes", "dask"])
def test_an_item_that_kills_whoever_has_it_is_named(compute):
    with pytest.raises(
        UserError, match=r"^deadly: item 2 of 4 ended [3-6] processes that computed it and nothing else"
    ):
        fan_out(killed_always, list(range(4)), compute, "deadly")


def simulated(deadly: int, innocent_too: int, log: list[list[int]]):
    """Return a `run` whose processes die of one item, with others beside it when several are given."""

    def run(numbers):
        log.append(list(numbers))
        for number in numbers:
            if number == deadly:
                raise WorkersLost(numbers[: innocent_too + 1], deaths=1)
            yield number, 10 * number

    return run


def test_suspects_run_alone_until_the_culprit_is_known():
    log: list[list[int]] = []
    results = {}
    with pytest.raises(UserError, match="item 3 of 6 "):
        for number, result in until_all_done(simulated(2, 3, log), 6, "some"):
            results[number] = result
    assert results == {0: 0, 1: 10}
    assert log == [[0, 1, 2, 3, 4, 5], [2, 3, 4, 5], [2, 3, 4, 5], [2], [2], [2]]


def test_a_death_by_chance_costs_nobody_the_blame():
    deaths = iter([True, True, True, False, True, False])

    def run(numbers):
        if next(deaths, False):
            raise WorkersLost(numbers[:2], deaths=1)
        yield from ((number, number) for number in numbers)

    assert dict(until_all_done(run, 5, "some")) == {number: number for number in range(5)}
