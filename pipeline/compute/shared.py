"""Something large that many tasks read: every worker process gets it once, not with each task."""

from __future__ import annotations

import pickle
import shutil
import tempfile
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Generic, TypeVar

Value = TypeVar("Value")

KEPT = 8  # values in a worker: those of the objects that it works on now, not of all that it has worked on


class Shared(Generic[Value]):
    """A handle that is cheap to send to another process; ``value`` is read there when it is first asked for.

    Use as a context manager: the file behind it is removed at the end, and workers of a cluster drop the value::

        with Shared(objects) as shared:
            fan_out(partial(work, shared), items, workers, "work")
    """

    def __init__(self, value: Value) -> None:
        self._value: Value | None = value
        self._folder: str | None = None
        self._endings: list[Callable[[], object]] = []

    @property
    def value(self) -> Value:
        """What is shared; it must not be changed."""
        return _read(self._folder) if self._value is None else self._value  # type: ignore[arg-type, return-value]

    def __enter__(self) -> Shared[Value]:
        return self

    def at_end(self, ending: Callable[[], object]) -> None:
        """Let ``ending`` be called when the context ends."""
        self._endings.append(ending)

    def __exit__(self, *_: object) -> None:
        while self._endings:
            self._endings.pop()()
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)

    def __getstate__(self) -> dict[str, str | None]:
        if self._folder is None:
            self._folder = tempfile.mkdtemp(prefix="shared-")
            with open(Path(self._folder) / "value.pickle", "wb") as target:
                pickle.dump(self._value, target, protocol=pickle.HIGHEST_PROTOCOL)
        return {"_folder": self._folder}

    def __setstate__(self, state: dict[str, str | None]) -> None:
        self._value, self._endings = None, []
        self._folder = state["_folder"]


@lru_cache(maxsize=KEPT)
def _read(folder: str) -> object:
    with open(Path(folder) / "value.pickle", "rb") as source:
        return pickle.load(source)
