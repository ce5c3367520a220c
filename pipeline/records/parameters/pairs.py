"""`pairs`: which objects are picked one after the other."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from functools import lru_cache
from typing import Annotated, Literal

from pydantic import Field

from pipeline.records.seeds import item_seed

PairsParameter = Literal["all"] | Annotated[int, Field(ge=1)] | list[tuple[str, str]]

EXCESS = 1.25  # most partners of a second object, in parts of an even share


def partners(
    firsts: Sequence[str], seconds: Sequence[str], pairs: PairsParameter, seed: int
) -> dict[str, tuple[str, ...]]:
    """Return, for each first object, the objects that are picked after it, in the order of ``seconds``.

    Args:
        pairs: ``all``; or how many partners each first object gets; or the pairs themselves.
        seed: the run's; with a number of partners it decides which.

    Drawn partners are balanced: no second object has more than ``EXCESS`` times an even share, and each has at least
    one. They are also stable: a first object added at the end of the list changes the partners of few others, as each
    prefers the second objects in an order of its own (consistent hashing with bounded loads, Mirrokni et al. 2018).
    """
    if pairs == "all":
        return {first: tuple(seconds) for first in firsts}
    if not isinstance(pairs, int):
        chosen = {first: {second for name, second in pairs if name == first} for first in firsts}
        return {first: tuple(name for name in seconds if name in own) for first, own in chosen.items()}
    return dict(_drawn(tuple(firsts), tuple(seconds), pairs, seed))


@lru_cache(maxsize=4)
def _drawn(
    firsts: tuple[str, ...], seconds: tuple[str, ...], pairs: int, seed: int
) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Return :func:`partners` of a number; a thousand objects with a thousand take seconds, and are asked for twice."""
    most = math.ceil(EXCESS * len(firsts) * min(pairs, len(seconds)) / max(len(seconds), 1))
    load: Counter[str] = Counter()
    drawn: dict[str, set[str]] = {}
    for first in firsts:
        preferred = sorted(seconds, key=lambda second: item_seed(seed, "pairs", first, second))
        free = [second for second in preferred if load[second] < most]
        full = (second for second in preferred if load[second] >= most)
        drawn[first] = set([*free, *full][:pairs])
        load.update(drawn[first])
    for second in seconds:
        if firsts and not load[second]:
            drawn[min(firsts, key=lambda first: item_seed(seed, "pairs", first, second))].add(second)
    return tuple((first, tuple(name for name in seconds if name in own)) for first, own in drawn.items())
