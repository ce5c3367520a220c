"""A process that is killed in the middle loses no work, on either backend."""

from functools import partial

import pytest

from pipeline.compute.fan_out import fan_out
from pipeline.compute.losses import Losses
from pipeline.compute.pool import run_all
from pipeline.records.errors import UserError
from pipeline.records.parameters.compute import ComputeParameters
from tests.compute.items import counted, counting, killed_always, killed_once, run_items

pytest.importorskip("distributed", reason="needs the extra `cluster`")

PROCESSES = ComputeParameters(backend="processes", workers=2)
DASK = ComputeParameters(backend="dask", workers=2)


@pytest.mark.parametrize("compute", [PROCESSES, DASK], ids=["processes", "dask"])
def test_a_killed_worker_loses_no_work(compute, tmp_path):
    items = list(range(40))
    assert fan_out(partial(killed_once, tmp_path), items, compute, "killed once") == [item * item for item in items]
    tries = [(tmp_path / f"{item}").read_text().split() for item in items]
    assert len(set(tries[30])) == 2  # in another process
    assert max(map(len, tries)) == 2


@pytest.mark.slow
@pytest.mark.parametrize("compute", [PROCESSES, DASK], ids=["processes", "dask"])
def test_a_call_that_kills_whoever_has_it_is_named(compute):
    with pytest.raises(UserError, match=r"^deadly: call 2 of 4 ended [3-6] processes"):
        fan_out(killed_always, list(range(4)), compute, "deadly")


@pytest.mark.slow
def test_what_was_finished_before_a_killer_is_named_stays_finished():
    results = {}

    def done(key, result):
        results[key] = result

    # Done before anything dies: in later rounds it might be under way beside the killer.
    works = [("first", lambda: counting(5, 0)), ("killer", lambda: counting(0, 1, killed_always))]
    with pytest.raises(UserError, match="^killer: call 2 of 3 "):
        run_all(works, PROCESSES, "test", done)
    assert results == {"first": counted(5, 0)}
    assert run_items({"later": lambda: counting(1, 2)}, PROCESSES) == {"later": counted(1, 2)}


def losses() -> Losses[tuple[int, ...]]:
    return Losses(
        lambda batch: [(number,) for number in batch] if len(batch) > 1 else [batch], lambda batch: f"{batch[0]}"
    )


def test_suspects_run_alone_until_the_culprit_is_known():
    """Call 2 kills; 1, 2 and 3 were sent together, and (4, 5) were with another worker that died."""
    decided = losses()
    batches = [(1, 2, 3), (4, 5)]
    assert decided.lost(batches, 1) == batches and not decided.suspecting
    assert decided.lost(batches, 1) == batches and not decided.suspecting
    assert decided.lost(batches, 1) == [] and decided.suspecting
    assert decided.next_alone() == (1, 2, 3)
    assert decided.lost([(1, 2, 3)], 1) == []
    alone = [decided.next_alone()]
    decided.finished(alone[0])
    for _ in range(2):
        alone.append(decided.next_alone())
        assert decided.lost([alone[-1]], 1) == []
    alone.append(decided.next_alone())
    with pytest.raises(UserError, match="^2 ended 3 "):
        decided.lost([alone[-1]], 1)
    assert alone == [(1,), (2,), (2,), (2,)]


def test_deaths_by_chance_cost_nobody_the_blame():
    decided = losses()
    assert decided.lost([(1, 2)], 2) == [(1, 2)]
    assert decided.lost([(7,), (8,)], 1) == []
    for _ in range(2):
        assert decided.next_alone() == (7,)
        decided.lost([(7,)], 1)
    for suspect in ((7,), (8,)):
        assert decided.next_alone() == suspect
        decided.finished(suspect)
    assert not decided.suspecting
    assert decided.lost([(9,)], 2) == [(9,)]  # from zero again
