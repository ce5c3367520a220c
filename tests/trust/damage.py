"""Input that somebody damaged or made up: either it is valid, or one sentence says what is wrong with it."""

from __future__ import annotations

import os
import resource
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from pipeline.records.errors import UserError

# More of the same, and what takes minutes, by hand: TRUST=100 ./dev test tests/trust
TIMES = int(os.environ.get("TRUST", "1"))
by_hand = pytest.mark.skipif("TRUST" not in os.environ, reason="takes minutes: TRUST=1 ./dev test tests/trust")
MEMORY = 2 << 30  # bytes that reading one small file may take at most
SECONDS = 10.0  # of the processor that it may take


def examples(count: int) -> settings:
    """Settings of a test on `count` examples, the same ones in every run."""
    return settings(
        max_examples=count * TIMES,
        deadline=None,
        derandomize=TIMES == 1,
        database=None,
        suppress_health_check=list(HealthCheck),
    )


class Hangs(BaseException):
    """No `except Exception` of a reader may hide it."""


@contextmanager
def bounded() -> Iterator[None]:
    """Stop what takes too long, and refuse memory that no small file needs."""

    def stop(*_: object) -> None:
        raise Hangs(f"more than {SECONDS} s")

    pages = int(Path("/proc/self/statm").read_text().split()[0])
    old, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MEMORY, hard))
    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
        resource.setrlimit(resource.RLIMIT_AS, (old, hard))


def valid_or_one_sentence(read: Callable[[], object]) -> str:
    """Return '' when `read` returns, or the sentence of its refusal; anything else that it raises is a defect."""
    try:
        with bounded():
            read()
    except Hangs as hang:
        raise AssertionError(str(hang)) from None  # its traceback may begin anywhere
    except UserError as error:
        sentence = str(error)
        assert sentence and "\n" not in sentence and sentence.endswith("."), sentence
        assert len(sentence) < 1500, sentence
        return sentence
    return ""


edits = st.lists(
    st.tuples(
        st.sampled_from(["flip", "set", "cut", "drop", "double", "insert", "number", "swap"]),
        st.floats(0, 1, exclude_max=True),
        st.integers(0, 255),
        st.integers(1, 64),
    ),
    min_size=1,
    max_size=4,
)
_NUMBERS = [b"-1", b"0", b"999999999999", b"1e999", b"nan", b"4294967295", b"0.5", b""]


def damaged(content: bytes, changes: list[tuple[str, float, int, int]]) -> bytes:
    """Apply the edits to a file's bytes; most files say what they hold at their beginning, so half of them go there."""
    for kind, where, value, length in changes:
        near = len(content) if value % 2 else min(len(content), 600)
        at = int(where * near)
        match kind:
            case "flip":
                content = content[:at] + bytes([content[at] ^ (1 << value % 8)] if content else []) + content[at + 1 :]
            case "set":
                content = content[:at] + bytes([value]) + content[at + 1 :]
            case "cut":
                content = content[:at]
            case "drop":
                content = content[:at] + content[at + length :]
            case "double":
                content = content[:at] + content[at : at + length] * 2 + content[at + length :]
            case "insert":
                content = content[:at] + bytes([value]) * length + content[at:]
            case "number":
                begin = next((i for i in range(at, len(content)) if 48 <= content[i] <= 57), len(content))
                end = next((i for i in range(begin, len(content)) if not 48 <= content[i] <= 57), len(content))
                content = content[:begin] + _NUMBERS[value // 2 % len(_NUMBERS)] + content[end:]
            case "swap":
                content = content[at:] + content[:at]
    return content
