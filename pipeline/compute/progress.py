"""Progress bars of long work, on stderr."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from typing import TypeVar

Item = TypeVar("Item")


def watched(items: Iterable[Item], total: int, label: str) -> Iterator[Item]:
    """Yield ``items`` unchanged while a bar named ``label`` shows how many of ``total`` are done."""
    from tqdm import tqdm

    yield from tqdm(items, total=total, desc=label, file=sys.stderr, mininterval=1.0)
