"""What a stage has cost so far: processor time and peak memory of its process and of all its workers."""

from __future__ import annotations

import os
import resource
from pathlib import Path

TICKS_PER_SECOND = os.sysconf("SC_CLK_TCK")


def _living_workers() -> list[int]:
    """Process numbers of all living descendants; the pool keeps its workers until the stage's process ends."""
    children: dict[int, list[int]] = {}
    for entry in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(entry.read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue  # it ended meanwhile
        children.setdefault(parent, []).append(int(entry.parent.name))
    found, waiting = [], [os.getpid()]
    while waiting:
        offspring = children.get(waiting.pop(), [])
        found += offspring
        waiting += offspring
    return found


def _cost_of_worker(process: int) -> tuple[float, int]:
    """Return processor seconds and peak kilobytes of a living process, zeros if it has just ended."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        status = Path(f"/proc/{process}/status").read_text()
    except OSError:
        return 0.0, 0
    peak = next((line.split()[1] for line in status.splitlines() if line.startswith("VmHWM:")), "0")
    # Its own time, and that of the children that it has waited for: calls in processes of their own.
    return sum(map(int, fields[11:15])) / TICKS_PER_SECOND, int(peak)


def cost_so_far() -> tuple[float, float]:
    """Return processor seconds of this process and all its descendants, and the peak MB of the largest of them.

    The operating system adds up ended children only, and a pool's workers are alive until the very end; so living
    ones are looked up (on Linux; elsewhere they are left out).
    """
    own, ended = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    living = [_cost_of_worker(process) for process in _living_workers()]
    seconds = own.ru_utime + own.ru_stime + ended.ru_utime + ended.ru_stime + sum(cost[0] for cost in living)
    return seconds, max([own.ru_maxrss, ended.ru_maxrss, *(cost[1] for cost in living)]) / 1024
