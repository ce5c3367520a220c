"""Native code that reads strangers' data, in a process of its own: its crash or its endless loop becomes an exception.

A library in C++ can end the process that calls it, or never return, on a mesh or a photo that somebody else made.
:func:`guarded` calls it in a child with limits on time and memory. The children are forks of one process that has
loaded the libraries already (:mod:`pipeline.compute.guard_server`), so that a call costs milliseconds.
"""

from __future__ import annotations

import atexit
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from typing import Any, TypeVar

from pipeline.compute import guard_server
from pipeline.compute.guard_server import Call, Reply, receive, send

Result = TypeVar("Result")

IDLE_SECONDS = 30.0  # at most, that a call may sleep


class CallLost(Exception):
    """A call that did not return; ``str()`` says how it ended, as in "ended by SIGABRT"."""

    def __init__(self, how: str, said: str = "") -> None:
        """Tell how it ended and what it printed last."""
        super().__init__(how)
        self.said = said


class _Server:
    """The process that forks, begun with the first call and anew after it has been lost."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._owner = 0

    def ask(self, call: Call) -> Reply:
        """Return how a call ended."""
        with self._lock:
            process = self._started()
            assert process.stdin and process.stdout
            try:
                send(process.stdin, call)  # type: ignore[arg-type]
                reply = receive(process.stdout)  # type: ignore[arg-type]
            except (EOFError, BrokenPipeError):
                self.end()
                return Reply(guard_server.SIGNAL)
            except BaseException:  # interrupted: the answer that is still to come belongs to nobody
                self.end()
                raise
            assert isinstance(reply, Reply)
            return reply

    def _started(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._owner != os.getpid() or self._process.poll() is not None:
            self._owner = os.getpid()
            self._process = subprocess.Popen(
                [sys.executable, "-m", "pipeline.compute.guard_server"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=os.environ | {"PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)},
            )
        return self._process

    def end(self) -> None:
        """End the process, and with it the call that is under way."""
        if self._process is not None and self._owner == os.getpid():
            self._process.kill()
            self._process.wait()
            for pipe in (self._process.stdin, self._process.stdout):
                if pipe is not None:
                    pipe.close()
        self._process = None


_SERVER = _Server()
atexit.register(_SERVER.end)


def guarded(function: Callable[..., Result], *arguments: Any, cpu_seconds: int, megabytes: int) -> Result:
    """Return ``function(*arguments)``, computed in a process of its own.

    Args:
        function: of module level; it and its arguments go there as pickles.
        cpu_seconds: processor time that the call may take, of all its threads.
        megabytes: memory that it may take beyond what the libraries occupy.

    Raises:
        CallLost: it ended its process, or took more than it may.
        Exception: whatever the function raised.
    """
    idle_seconds = min(IDLE_SECONDS, 2.0 * cpu_seconds)
    call = Call(pickle.dumps(function), pickle.dumps(arguments), cpu_seconds, idle_seconds, megabytes)
    reply = _SERVER.ask(call)
    if reply.ending == guard_server.FINISHED:
        result: Result = pickle.loads(reply.content)
        return result
    if reply.ending == guard_server.RAISED:
        raise pickle.loads(reply.content)
    if reply.ending == guard_server.TIME:
        raise CallLost(f"not done after {cpu_seconds} seconds of processor time", reply.said)
    if reply.ending == guard_server.STOPPED:
        raise CallLost("came to a stop without an end", reply.said)
    if reply.ending == guard_server.MEMORY or "bad_alloc" in reply.said:
        raise CallLost(f"more than {megabytes} MB of memory needed", reply.said)
    known = {each.value: each.name for each in signal.Signals}
    raise CallLost(f"ended by {known.get(reply.signal, 'an exit of its own')}", reply.said)
