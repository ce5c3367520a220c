"""Whatever a guarded call does to its process, the caller gets a result or an exception (faults/mesh-native-abort)."""

import ctypes
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from pipeline.compute.guard import CallLost, guarded
from pipeline.records.errors import UserError

SMALL = {"cpu_seconds": 5, "megabytes": 500}


def doubled(array):
    print("a native library's own line")
    os.write(2, b"another")
    return 2 * array


def refuse(name):
    raise UserError(f"{name}: that is no mesh.")


def abort():
    os.write(2, b"Assertion `t >= 0' failed")
    os.abort()


def follow_a_null_pointer():
    ctypes.string_at(0)


def loop():
    while True:
        pass


def sleep(seconds):
    time.sleep(seconds)


def fill(megabytes):
    return len(bytearray(megabytes * 2**20))


def leave():
    os._exit(3)


def test_results_come_back_and_nothing_is_printed(capfd):
    array = np.arange(3_000_000.0)  # more than a pipe holds
    np.testing.assert_array_equal(guarded(doubled, array, **SMALL), 2 * array)
    assert capfd.readouterr() == ("", "")


def test_an_exception_is_raised_here():
    with pytest.raises(UserError, match=r"^mug: that is no mesh\.$"):
        guarded(refuse, "mug", **SMALL)


@pytest.mark.parametrize(
    ("function", "arguments", "how"),
    [
        (abort, (), "ended by SIGABRT"),
        (follow_a_null_pointer, (), "ended by SIGSEGV"),
        (leave, (), "ended by an exit of its own"),
        (loop, (), "not done after 1 seconds of processor time"),
        (sleep, (60,), "came to a stop without an end"),
        (fill, (900,), "more than 500 MB of memory needed"),
    ],
)
def test_the_end_of_the_process_is_said_and_the_next_call_works(function, arguments, how):
    begin = time.monotonic()
    with pytest.raises(CallLost) as lost:
        guarded(function, *arguments, cpu_seconds=1, megabytes=500)
    assert str(lost.value) == how and time.monotonic() - begin < 20
    assert function is not abort or "Assertion `t >= 0' failed" in lost.value.said
    assert guarded(fill, 100, **SMALL) == 100 * 2**20


def test_a_call_costs_milliseconds():
    """The fastest of some, as other work on the machine only adds to it."""
    took = []
    for _ in range(20):
        begin = time.perf_counter()
        guarded(fill, 1, **SMALL)
        took.append(time.perf_counter() - begin)
    assert min(took) < 0.1


def test_a_killed_caller_leaves_no_process_behind(tmp_path):
    program = (
        "import time\nfrom pipeline.compute.guard import guarded\nfrom tests.compute.test_guard import note_and_sleep\n"
        f"guarded(note_and_sleep, {str(tmp_path / 'pid')!r}, cpu_seconds=100, megabytes=500)"
    )
    caller = subprocess.Popen([sys.executable, "-c", program])
    while not (tmp_path / "pid").exists() or not (tmp_path / "pid").read_text():
        time.sleep(0.05)
    caller.send_signal(signal.SIGKILL)
    caller.wait()
    process = int((tmp_path / "pid").read_text())
    for _ in range(100):
        try:
            os.kill(process, 0)
            with open(f"/proc/{process}/stat") as file:
                if file.read().rpartition(")")[2].split()[0] == "Z":
                    return
        except OSError:
            return
        time.sleep(0.1)
    raise AssertionError(f"process {process} goes on")


def note_and_sleep(path):
    with open(path, "w") as file:
        file.write(str(os.getpid()))
    time.sleep(600)
