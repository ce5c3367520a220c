"""Functions that every backend is given; importable, as workers import them."""

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

from pipeline.compute.executor import Workers
from pipeline.compute.pool import Calls, Work, run_all
from pipeline.compute.shared import Shared
from pipeline.stages.seeds import item_generator


def draw(index: int) -> list[float]:
    return item_generator(1, "test", "cube", index).normal(size=3).tolist()


def fail_on_three(index: int) -> int:
    if index == 3:
        raise LookupError("item three")
    return index


def add(number: int) -> int:
    return number + 1


def add_slowly(number: int) -> int:
    time.sleep(0.05)
    return number + 1


def killed_once(folder: Path, number: int) -> int:
    """Kill the process that computes 30, the first time; say who computed what."""
    with open(folder / f"{number}", "a") as log:
        log.write(f"{os.getpid()}\n")
    if number == 30 and len((folder / "30").read_text().split()) == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def killed_always(number: int) -> int:
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def total(shared: Shared, factor: int) -> tuple[float, int, int, str]:
    """Return a product with the sum of what is shared, and where that was found."""
    values = shared.value
    return float(values.sum() * factor), id(values), os.getpid(), str(vars(shared))


def weighted(first: Shared, second: Shared, offset: float, number: int, *, sign: int) -> float:
    return sign * (float(first.value.sum()) + number * float(second.value.sum())) + offset


def counting(start: int, rounds: int, function: Callable[[int], int] = add, width: int = 3) -> Work:
    """An item whose every round needs the results of the one before; returns all of them."""
    found = [start + offset for offset in range(width)]
    history = [found]
    for turn in range(rounds):
        found = yield Calls(function, found, turn / rounds, (turn + 1) / rounds)
        history.append(found)
    return history


def counted(start: int, rounds: int, width: int = 3) -> list[list[int]]:
    """What :func:`counting` returns, by arithmetic."""
    return [[start + turn + offset for offset in range(width)] for turn in range(rounds + 1)]


def run_items(works: dict[str, Callable[[], Work]], workers: Workers) -> dict[str, object]:
    results: dict[str, object] = {}
    run_all(list(works.items()), workers, "test", lambda key, result: results.update({key: result}))
    return results
