"""The process that :mod:`pipeline.compute.guard` keeps: it loads what calls need, and forks for every call.

It computes nothing itself, so it has no threads that a fork would lose, and a call begins within milliseconds. What
native libraries print goes to a file that only the sentence about a failed call draws on.
"""

from __future__ import annotations

import os
import pickle
import resource
import select
import signal
import struct
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, BinaryIO

_LENGTH = struct.Struct("<Q")
_CHUNK = 1 << 20
_SAID = 2000  # bytes of what a failed call printed last
_LOOK_SECONDS = 1.0  # between looks at a call's process
FINISHED, RAISED, TIME, STOPPED, MEMORY, SIGNAL = "finished", "raised", "time", "stopped", "memory", "signal"


@dataclass(frozen=True)
class Call:
    """A request: the function and its arguments, both pickled, and what the call may take."""

    function: bytes
    arguments: bytes
    cpu_seconds: int
    idle_seconds: float  # without using the processor
    megabytes: int


@dataclass(frozen=True)
class Reply:
    """How a call ended."""

    ending: str
    content: bytes = b""  # the pickled result or exception
    signal: int = 0
    said: str = ""  # what it printed last


def send(target: BinaryIO, message: object) -> None:
    """Write one message to a pipe."""
    content = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
    target.write(_LENGTH.pack(len(content)) + content)
    target.flush()


def receive(source: BinaryIO) -> Any:
    """Read one message from a pipe.

    Raises:
        EOFError: the other side has ended.
    """
    head = source.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        raise EOFError
    (length,) = _LENGTH.unpack(head)
    content = source.read(length)
    if len(content) < length:
        raise EOFError
    return pickle.loads(content)


def _allow(call: Call) -> None:
    """Limit this process to what a call may take."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (call.cpu_seconds, call.cpu_seconds + 2))
    with open("/proc/self/statm") as file:
        used = int(file.read().split()[0]) * resource.getpagesize()
    most = used + call.megabytes * 2**20
    resource.setrlimit(resource.RLIMIT_AS, (most, most))


def _compute(function: Callable[..., Any], call: Call, result: int) -> None:
    """Compute a call in this process, a fork, and write its ending and its pickled result."""
    try:
        _allow(call)
        content = FINISHED, pickle.dumps(function(*pickle.loads(call.arguments)), protocol=pickle.HIGHEST_PROTOCOL)
    except MemoryError:
        content = MEMORY, b""
    except Exception as error:
        try:
            content = RAISED, pickle.dumps(error)
        except Exception:  # an exception that holds what cannot be sent
            content = RAISED, pickle.dumps(RuntimeError(f"{type(error).__name__}: {error}"))
    with os.fdopen(result, "wb") as target:
        send(target, content)


class _Watch:
    """Tells whether a process has come to a stop: asleep without using the processor, which a busy machine is not."""

    def __init__(self, process: int) -> None:
        self._process, self._since = process, time.monotonic()
        self._ticks: list[str] = []

    def idle_seconds(self) -> float:
        """Return for how long it has been seen so."""
        with open(f"/proc/{self._process}/stat") as file:
            fields = file.read().rpartition(")")[2].split()
        if fields[0] != "S" or fields[11:13] != self._ticks:
            self._ticks, self._since = fields[11:13], time.monotonic()
        return time.monotonic() - self._since


def _read_all(result: int, orders: BinaryIO, watch: _Watch, idle_seconds: float) -> tuple[bytes, bool]:
    """Return what a call wrote until it ended, and whether it has come to a stop instead.

    Raises:
        EOFError: whoever asked for the call has ended.
    """
    parts: list[bytes] = []
    while watch.idle_seconds() < idle_seconds:
        ready, _, _ = select.select([result, orders.fileno()], [], [], _LOOK_SECONDS)
        if orders.fileno() in ready:
            raise EOFError  # nothing is sent while a call is under way: the pipe has been closed
        if ready:
            part = os.read(result, _CHUNK)
            if not part:
                return b"".join(parts), False
            parts.append(part)
    return b"".join(parts), True


def _last_words(log: BinaryIO) -> str:
    log.seek(max(0, log.seek(0, os.SEEK_END) - _SAID))
    return log.read().decode(errors="replace").strip()


def _answer(call: Call, orders: BinaryIO, log: BinaryIO) -> Reply:
    """Fork for a call and return how it ended."""
    log.truncate(0)
    try:
        function = pickle.loads(call.function)  # loads its module, once, in this process
    except Exception as error:
        return Reply(RAISED, pickle.dumps(RuntimeError(f"{type(error).__name__}: {error}")))
    result, own = os.pipe()
    if (process := os.fork()) == 0:
        os.close(result)
        try:
            _compute(function, call, own)
        finally:
            os._exit(0)
    os.close(own)
    try:
        content, stopped = _read_all(result, orders, _Watch(process), call.idle_seconds)
    except EOFError:
        os.kill(process, signal.SIGKILL)
        raise
    finally:
        os.close(result)
    if stopped:
        os.kill(process, signal.SIGKILL)
    _, status = os.waitpid(process, 0)
    killed_by = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
    if stopped:
        return Reply(STOPPED, said=_last_words(log))
    if killed_by == signal.SIGXCPU:
        return Reply(TIME, said=_last_words(log))
    if killed_by or len(content) < _LENGTH.size:
        return Reply(SIGNAL, signal=killed_by, said=_last_words(log))
    ending, value = pickle.loads(content[_LENGTH.size :])
    return Reply(ending, value, said="" if ending == FINISHED else _last_words(log))


def main() -> None:
    """Answer calls until the process that asks for them ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends whoever asks
    orders, replies = os.fdopen(os.dup(0), "rb", buffering=0), os.fdopen(os.dup(1), "wb")
    with tempfile.TemporaryFile() as log:
        for descriptor in (1, 2):
            os.dup2(log.fileno(), descriptor)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        while True:
            try:
                call = receive(_Whole(orders))  # type: ignore[arg-type]
                send(replies, _answer(call, orders, log))
            except (EOFError, BrokenPipeError):
                return


class _Whole:
    """A pipe whose reads return as much as was asked for, and hold nothing back that ``select`` would wait for."""

    def __init__(self, source: BinaryIO) -> None:
        self._source = source

    def read(self, length: int) -> bytes:
        parts = []
        while length > 0 and (part := self._source.read(min(length, _CHUNK))):
            parts.append(part)
            length -= len(part)
        return b"".join(parts)


if __name__ == "__main__":
    # Pickles name the classes of the module as the other side imports it.
    from pipeline.compute import guard_server

    guard_server.main()
    sys.exit(0)
