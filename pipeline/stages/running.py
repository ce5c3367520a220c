"""What every command does around its own work: errors in one sentence and, for a stage, a line of durations."""

from __future__ import annotations

import errno
import fcntl
import functools
import json
import os
import sys
import time
import traceback
from collections.abc import Callable
from typing import ParamSpec

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.writing import write_json
from pipeline.stages.cost import cost_so_far
from pipeline.stages.failures import defect, write_log

Arguments = ParamSpec("Arguments")
DEFECTIVE, REFUSED, INTERRUPTED = 1, 2, 130  # exit codes


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


def command(name: str) -> Callable[[Callable[Arguments, int]], Callable[Arguments, int]]:
    """Return a decorator for what a command does, a function that returns its exit code.

    A :class:`UserError`, and a file or disk that cannot be used, end in one line on stderr and exit code 2. Anything
    else is a defect of ours: one line, too, with the path of a log that holds the traceback, and exit code 1.

    Args:
        name: of the command; the line begins with it.
    """

    def decorated(work: Callable[Arguments, int]) -> Callable[Arguments, int]:
        @functools.wraps(work)
        def run(*args: Arguments.args, **kwargs: Arguments.kwargs) -> int:
            try:
                return work(*args, **kwargs)
            except UserError as error:
                sentence = str(error)
            except OSError as error:
                if error.errno in (errno.ENOSPC, errno.EDQUOT):
                    sentence = "the disk is full; free some space and run again."
                elif error.filename is not None:
                    sentence = f"cannot use {os.fspath(error.filename)}: {error.strerror}."
                else:
                    return _defective(name, error)
            except KeyboardInterrupt:
                print(f"{name}: interrupted; run again to go on.", file=sys.stderr)
                return INTERRUPTED
            except Exception as error:
                return _defective(name, error)
            print(f"{name}: {sentence}", file=sys.stderr)
            return REFUSED

        return run

    return decorated


def _defective(name: str, error: Exception) -> int:
    """Say that the program is at fault, with the path of a log, and return the exit code."""
    log = write_log(name, traceback.format_exc())
    print(f"{name}: stopped by {defect(error)}; please report it with the log {log}.", file=sys.stderr)
    return DEFECTIVE


def run_stage(item: str, work: Callable[[], None]) -> int:
    """Run one stage and return its exit code.

    Args:
        item: the DVC name of the stage, such as ``synthesize@pinch``.
        work: everything the stage does.
    """

    @command(item)
    def measured() -> int:
        begin = time.perf_counter()
        work()
        _record_duration(item, time.perf_counter() - begin)
        return 0

    return measured()
