"""Items whose rounds of calls share one pool of workers."""

from collections import Counter, deque
from functools import partial

import pytest

from pipeline.compute.executor import AHEAD, Executor, OwnProcess, compute_batch
from pipeline.compute.losses import WorkersLost
from pipeline.compute.pool import Calls, run_all, run_on
from pipeline.compute.shared import Shared
from pipeline.records.errors import UserError
from pipeline.records.parameters.compute import ComputeParameters
from tests.compute.items import add, add_slowly, counted, counting, draw, fail_on_three, run_items

WAYS = [1, 2, pytest.param(ComputeParameters(backend="dask", workers=2), id="dask")]


class Recorder:
    """An executor that computes what was submitted first, says that it took ``seconds`` a call, and keeps a log."""

    def __init__(
        self, workers: int, seconds: float = 10.0, batch_seconds: float = 2.0, sending_seconds: float = 0.0
    ) -> None:
        self.batch_seconds, self.sending_seconds = batch_seconds, sending_seconds
        self.seconds, self.workers = seconds, workers
        self.batches: list[list[object]] = []
        self.cancelled = False
        self._waiting: deque = deque()

    def room(self) -> int:
        return AHEAD * self.workers

    def prepare(self, function):
        return function

    def submit(self, key, prepared, arguments) -> None:
        assert len(self._waiting) < self.room()
        self.batches.append(list(arguments))
        self._waiting.append((key, prepared, arguments))

    def finished(self):
        key, function, arguments = self._waiting.popleft()
        results, _ = compute_batch(function, arguments)
        return key, results, self.seconds * len(arguments)

    def cancel(self) -> None:
        self.cancelled = True


class Mortal(Recorder):
    """Loses whatever is under way when a batch with this argument is next, a number of times."""

    def __init__(self, workers: int, seconds: float, deadly: int, times: int) -> None:
        super().__init__(workers, seconds)
        self.deadly, self.times = deadly, times
        self.under_way: list[list[object]] = []  # when something died

    def finished(self):
        if self.times and self.deadly in self._waiting[0][2]:
            self.times -= 1
            lost = [key for key, *_ in self._waiting]
            self.under_way += [[argument for *_, arguments in self._waiting for argument in arguments]]
            self._waiting.clear()
            raise WorkersLost(lost, deaths=1)
        return super().finished()


def finished_by(executor: Executor, works) -> dict[str, object]:
    results: dict[str, object] = {}
    run_on(executor, works, "test", lambda key, result: results.update({key: result}))
    return results


@pytest.mark.parametrize("workers", WAYS)
def test_items_of_several_rounds_end_alike_everywhere(workers):
    if isinstance(workers, ComputeParameters):
        pytest.importorskip("distributed", reason="needs the extra `cluster`")
    works = {f"item {start}": partial(counting, start, start % 4) for start in range(0, 70, 7)}
    assert run_items(works, workers) == {f"item {start}": counted(start, start % 4) for start in range(0, 70, 7)}


def test_rounds_without_calls_and_items_without_rounds():
    def nothing():
        first = yield Calls(add, [])
        second = yield Calls(add, [])
        third = yield Calls(add, [1])
        return first, second, third

    def at_once():
        return "here"
        yield

    assert run_items({"nothing": nothing, "at once": at_once}, 2) == {"nothing": ([], [], [2]), "at once": "here"}
    assert run_items({}, 2) == {}


def test_items_begin_in_order_and_none_before_it_is_needed():
    log: list[str] = []

    def item(name: str):
        log.append(f"begin {name}")
        yield Calls(add, list(range(6)))
        log.append(f"end {name}")

    executor = Recorder(workers=2)
    finished_by(executor, [(name, partial(item, name)) for name in "abcdefgh"])
    assert [line for line in log if "begin" in line] == [f"begin {name}" for name in "abcdefgh"]
    opened = 0
    for line in log:
        opened += 1 if "begin" in line else -1
        assert opened <= 3  # 4 calls under way and 4 that wait are of no more than three items


def test_one_process_has_one_item_at_a_time():
    log: list[str] = []

    def item(name: str):
        log.append(f"begin {name}")
        for _ in range(3):
            yield Calls(add, [1, 2])
        log.append(f"end {name}")

    finished_by(OwnProcess(), [(name, partial(item, name)) for name in "abc"])
    assert log == [f"{what} {name}" for name in "abc" for what in ("begin", "end")]


def test_calls_of_earlier_items_go_first():
    executor = Recorder(workers=1)
    finished_by(executor, [("long", partial(counting, 0, 3, width=2)), ("short", partial(counting, 100, 1, width=9))])
    numbers = [number for batch in executor.batches for number in batch]
    # The second round of the first item passes what is left of the second item.
    assert numbers.index(2) < numbers.index(108) and numbers[:2] == [0, 1]


def test_short_calls_are_sent_together_and_long_ones_singly():
    for seconds, most in ((0.1, 20), (0.5, 4), (5.0, 1)):
        executor = Recorder(workers=2, seconds=seconds)
        assert finished_by(executor, [("item", partial(counting, 0, 1, width=400))]) == {
            "item": counted(0, 1, width=400)
        }
        sizes = list(map(len, executor.batches))
        assert max(sizes) == most and sum(sizes) == 400
        assert len(sizes) <= 400 / most + 40


def test_batches_shrink_at_the_end_so_that_no_worker_idles():
    executor = Recorder(workers=4, seconds=0.01)
    finished_by(executor, [("item", partial(counting, 0, 1, width=1000))])
    sizes = list(map(len, executor.batches))
    left = 1000
    for size in sizes:
        assert size <= max(1, left // 8)
        left -= size
    assert len(sizes) < 150


def test_batches_do_not_shrink_below_what_can_be_sent_in_time():
    """All items have begun, so that few calls wait at any time: 50 workers would take 500 single calls a second."""
    executor = Recorder(workers=50, seconds=0.1, sending_seconds=0.005)
    finished_by(executor, [(f"{start}", partial(counting, start, 20, width=20)) for start in range(0, 5000, 100)])
    batches, calls = len(executor.batches), sum(map(len, executor.batches))
    seconds_of_work = calls * 0.1 / 50
    assert calls == 50 * 20 * 20
    assert batches * 0.005 < seconds_of_work


def test_short_calls_of_several_items_go_together():
    executor = Recorder(workers=2, seconds=0.01)
    starts = range(0, 10_000, 100)
    results = finished_by(executor, [(f"{start}", partial(counting, start, 2, width=5)) for start in starts])
    assert results == {f"{start}": counted(start, 2, width=5) for start in starts}
    assert max(len({number // 100 for number in batch}) for batch in executor.batches) > 1


def add_both(shared, number):
    return number + shared.value


def test_a_batch_is_of_one_function_with_one_shared_value():
    executor = Recorder(workers=2, seconds=0.01)
    ones, thousands = Shared(1), Shared(1000)
    starts = range(0, 10_000, 100)
    work = {start: partial(add_both, thousands if start % 200 else ones) for start in starts}
    results = finished_by(
        executor, [(f"{start}", partial(counting, start, 1, function, width=5)) for start, function in work.items()]
    )
    for start in starts:
        step = 1000 if start % 200 else 1
        assert results[f"{start}"][-1] == [start + offset + step for offset in range(5)]


def test_nothing_to_send_makes_no_batches():
    executor = Recorder(workers=1, seconds=0.001, batch_seconds=0.0)
    finished_by(executor, [("item", partial(counting, 0, 1, width=30))])
    assert set(map(len, executor.batches)) == {1}


def test_results_come_while_others_still_run():
    seen: list[tuple[str, int]] = []
    running: set[str] = set()

    def item(name: str, rounds: int):
        running.add(name)
        yield from counting(0, rounds, add_slowly)
        running.remove(name)

    run_all(
        [("long", partial(item, "long", 20)), ("short", partial(item, "short", 1))],
        2,
        "test",
        lambda key, _: seen.append((key, len(running))),
    )
    assert seen == [("short", 1), ("long", 0)]


@pytest.mark.parametrize("workers", WAYS)
def test_an_error_of_a_call_ends_everything_but_what_was_done(workers):
    if isinstance(workers, ComputeParameters):
        pytest.importorskip("distributed", reason="needs the extra `cluster`")
    finished: dict[str, object] = {}
    closed: list[str] = []

    def item(name: str, calls: list[Calls]):
        try:
            for each in calls:
                assert len((yield each)) == len(each.arguments)
        finally:
            closed.append(name)

    works = [
        ("good", partial(item, "good", [Calls(draw, [1])])),
        ("bad", partial(item, "bad", [Calls(add_slowly, list(range(6))), Calls(fail_on_three, [1, 2, 3])])),
        ("other", partial(item, "other", [Calls(add_slowly, list(range(40)))])),
    ]
    with pytest.raises(LookupError, match="item three"):
        run_all(works, workers, "test", lambda key, result: finished.update({key: result}))
    assert finished == {"good": None}
    assert set(closed) >= {"good", "bad"}
    assert run_items({"again": partial(counting, 1, 2)}, workers) == {"again": counted(1, 2)}


def test_an_error_between_rounds_ends_everything_and_closes_the_others():
    closed: list[str] = []

    def bad():
        yield Calls(add, [1])
        raise UserError("it cannot be done")

    def good():
        try:
            yield Calls(add, list(range(9)))
        finally:
            closed.append("good")

    executor = Recorder(workers=1)
    with pytest.raises(UserError, match="^it cannot be done$"):
        finished_by(executor, [("bad", bad), ("good", good)])
    assert closed == ["good"] and executor.cancelled


def test_an_error_in_what_is_done_with_a_result_ends_everything():
    def full(key: str, result: object) -> None:
        raise OSError(28, "no space")

    with pytest.raises(OSError, match="no space"):
        run_all([("a", partial(counting, 0, 1)), ("b", partial(counting, 0, 1))], 2, "test", full)


def test_only_what_was_under_way_runs_again():
    executor = Mortal(workers=2, seconds=0.1, deadly=205, times=1)
    works = [(f"{start}", partial(counting, start, 1, width=30)) for start in range(0, 1000, 100)]
    assert finished_by(executor, works) == {f"{start}": counted(start, 1, width=30) for start in range(0, 1000, 100)}
    sent = Counter(number for batch in executor.batches for number in batch)
    assert sorted(number for number, times in sent.items() if times == 2) == sorted(executor.under_way[0])
    assert max(sent.values()) == 2 and 205 in executor.under_way[0]


def test_after_deaths_suspects_run_alone_and_then_all_go_on():
    executor = Mortal(workers=2, seconds=0.1, deadly=205, times=5)
    works = [(f"{start}", partial(counting, start, 1, width=30)) for start in range(0, 1000, 100)]
    assert finished_by(executor, works) == {f"{start}": counted(start, 1, width=30) for start in range(0, 1000, 100)}
    # Three times beside others, then in its batch alone, then as the only call.
    counts = list(map(len, executor.under_way))
    assert counts[2] > counts[3] > counts[4] == 1
    assert executor.under_way[4] == [205] and set(executor.under_way[3]) < set(executor.under_way[2])


def test_a_call_that_always_kills_is_named():
    executor = Mortal(workers=2, seconds=0.1, deadly=205, times=100)
    works = [(f"item {start}", partial(counting, start, 1, width=30)) for start in range(0, 1000, 100)]
    with pytest.raises(UserError, match="^item 200: call 6 of 30 ended 3 processes"):
        finished_by(executor, works)


def test_one_bar_shows_the_share_of_a_single_item(monkeypatch):
    shown: list[float] = []
    monkeypatch.setattr("pipeline.compute.progress.Bar._show", lambda bar: shown.append(sum(bar._shares.values())))
    finished_by(OwnProcess(), [("item", partial(counting, 0, 2, width=4))])
    assert shown == pytest.approx([0, 1 / 8, 2 / 8, 3 / 8, 4 / 8, 5 / 8, 6 / 8, 7 / 8, 0])


def failures(works, executor, keep=lambda key, result: None) -> dict[str, str]:
    """Run items and return what is said of those that failed, by key."""
    found: dict[str, str] = {}

    def failed(key, failure) -> None:
        assert key not in found, "an item failed twice"
        found[key] = f"{type(failure.error).__name__}: {failure.error}"
        assert type(failure.error).__name__ in failure.trace

    run_on(executor, works, "failing", keep, failed)
    return found


def failing(when: str):
    """An item that fails before its first round, in a call of it, or after it."""
    if when == "before":
        raise ValueError("before")
    numbers = yield Calls(fail_on_three, [3, 4, 5] if when == "in" else [4])
    if when == "after":
        raise ValueError("after")
    return numbers


def refuse_to_begin():
    raise ValueError("no beginning")


def test_an_item_that_fails_takes_no_other_along():
    results = {}
    works = [(f"good {number}", lambda: counting(1, 3)) for number in range(3)]
    works[1:1] = [(when, lambda when=when: failing(when)) for when in ("before", "in", "after")]
    works.insert(0, ("none", refuse_to_begin))
    said = failures(works, Recorder(2), results.__setitem__)
    assert said == {
        "none": "ValueError: no beginning",
        "before": "ValueError: before",
        "in": "LookupError: item three",
        "after": "ValueError: after",
    }
    assert set(results) == {"good 0", "good 1", "good 2"} and len({str(value) for value in results.values()}) == 1


def test_an_item_that_ends_every_process_takes_no_other_along():
    results = {}
    works = [("good", lambda: counting(1, 2)), ("deadly", lambda: counting(700, 1)), ("last", lambda: counting(9, 1))]
    said = failures(works, Mortal(2, 10.0, deadly=700, times=99), results.__setitem__)
    assert set(said) == {"deadly"} and "ended 3 processes that computed it and nothing else" in said["deadly"]
    assert set(results) == {"good", "last"}


def test_what_a_failure_raises_itself_ends_everything():
    def failed(key, failure) -> None:
        raise UserError("the disk is full")

    executor = Recorder(1)
    with pytest.raises(UserError, match="the disk is full"):
        run_on(executor, [("in", lambda: failing("in")), ("later", lambda: counting(1, 9))], "x", print, failed)
