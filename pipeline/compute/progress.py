"""Progress bars of long work, on stderr."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from types import TracebackType
from typing import TypeVar

Item = TypeVar("Item")


def watched(items: Iterable[Item], total: int, label: str) -> Iterator[Item]:
    """Yield ``items`` unchanged while a bar named ``label`` shows how many of ``total`` are done."""
    from tqdm import tqdm

    yield from tqdm(items, total=total, desc=label, file=sys.stderr, mininterval=1.0)


class Bar:
    """A bar named ``label`` over ``total`` items that are under way at the same time, each done to some share."""

    def __init__(self, total: int, label: str) -> None:
        from tqdm import tqdm

        self._total, self._finished = total, 0
        self._shares: dict[int, float] = {}
        self._bar = tqdm(
            total=total,
            desc=label,
            file=sys.stderr,
            mininterval=1.0,
            miniters=0,
            bar_format="{desc}: {percentage:3.0f}%|{bar}| [{elapsed}<{remaining}{postfix}]",
        )

    def __enter__(self) -> Bar:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.close()

    def moved(self, item: int, share: float) -> None:
        """Show that this share of an item is done, 0 to 1."""
        self._shares[item] = share
        self._show()

    def finished(self, item: int) -> None:
        """Show that an item is done."""
        self._shares.pop(item, None)
        self._finished += 1
        if self._total > 1:
            self._bar.set_postfix_str(f"{self._finished} of {self._total}", refresh=False)
        self._show()

    def _show(self) -> None:
        self._bar.update(self._finished + sum(self._shares.values()) - self._bar.n)
