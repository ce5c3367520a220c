"""Progress bars of long work, on stderr."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from types import TracebackType
from typing import Any, TypeVar

from tqdm import tqdm

Item = TypeVar("Item")


def watched(items: Iterable[Item], total: int, label: str) -> Iterator[Item]:
    """Yield ``items`` unchanged while a bar named ``label`` shows how many of ``total`` are done."""
    yield from tqdm(items, total=total, desc=label, file=sys.stderr, mininterval=1.0)


class Bar:
    """A bar named ``label`` over ``total`` items that are under way at the same time, each done to some share.

    It appears with the first item that has begun, so that what is wrong with the input is said without it.
    """

    def __init__(self, total: int, label: str) -> None:
        self._total, self._label, self._finished = total, label, 0
        self._shares: dict[int, float] = {}
        self._shown: tqdm[Any] | None = None

    def __enter__(self) -> Bar:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._shown is not None:
            self._shown.close()

    def moved(self, item: int, share: float) -> None:
        """Show that this share of an item is done, 0 to 1."""
        self._shares[item] = share
        self._show()

    def finished(self, item: int) -> None:
        """Show that an item is done."""
        self._shares.pop(item, None)
        self._finished += 1
        if self._total > 1:
            self._bar().set_postfix_str(f"{self._finished} of {self._total}", refresh=False)
        self._show()

    def _show(self) -> None:
        bar = self._bar()
        bar.update(self._finished + sum(self._shares.values()) - bar.n)

    def _bar(self) -> tqdm[Any]:
        if self._shown is None:
            self._shown = tqdm(
                total=self._total,
                desc=self._label,
                file=sys.stderr,
                mininterval=1.0,
                miniters=0,
                bar_format="{desc}: {percentage:3.0f}%|{bar}| [{elapsed}<{remaining}{postfix}]",
            )
        return self._shown
