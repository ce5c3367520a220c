"""What every stage's command does around its own work: one-sentence errors and a line of durations."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import sys
import time
from collections.abc import Callable

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.writing import write_json
from pipeline.stages.cost import cost_so_far


def _record_duration(item: str, wall_seconds: float) -> None:
    """Add one stage's cost to ``reports/durations.json``, a file that nothing depends on."""
    cpu_seconds, peak_megabytes = cost_so_far()
    entry = {
        "wall_seconds": round(wall_seconds, 2),
        "cpu_seconds": round(cpu_seconds, 2),
        "peak_megabytes_largest_process": round(peak_megabytes, 1),
    }
    paths.DURATIONS_FILE.parent.mkdir(parents=True, exist_ok=True)
    with open(paths.DURATIONS_FILE.with_name(".durations.lock"), "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        try:
            known = json.loads(paths.DURATIONS_FILE.read_text())
        except (OSError, ValueError):
            known = {}
        known[item] = entry
        write_json(paths.DURATIONS_FILE, known)


def run_stage(item: str, work: Callable[[], None]) -> int:
    """Run one stage and return its exit code.

    Args:
        item: the DVC name of the stage, such as ``synthesize@pinch``.
        work: everything the stage does.

    A :class:`UserError` ends in one line on stderr and exit code 2; anything else is a defect of ours and keeps its
    traceback.
    """
    begin = time.perf_counter()
    try:
        work()
        _record_duration(item, time.perf_counter() - begin)
    except UserError as error:
        print(f"{item}: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            print(f"{item}: the disk is full; free some space and run again.", file=sys.stderr)
            return 2
        if error.filename is None:
            raise
        print(f"{item}: cannot use {os.fspath(error.filename)}: {error.strerror}.", file=sys.stderr)
        return 2
    return 0
