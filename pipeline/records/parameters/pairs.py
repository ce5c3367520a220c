"""`pairs`: which objects are picked one after the other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from pipeline.records.parameters.section import Section
from pipeline.stages.seeds import item_seed


class PartnersWithin(Section):
    """Partners of one origin: a model that was not trained on an origin knows neither object of its pairs."""

    partners: int = Field(ge=1, description="Number of partners of each first object.")
    within: list[str] = Field(
        min_length=1,
        description="First parts of objects' names, such as sources under `assets`: objects whose names begin with one "
        "of them are paired among themselves, all others with each other.",
    )
    only_trained: list[str] = Field(
        [],
        description="Those of `within` whose pairs are merged for the training alone: the model is not sampled for "
        "them, and the robot does not try them.",
    )

    @model_validator(mode="after")
    def _known(self) -> Self:
        if unknown := sorted(set(self.only_trained) - set(self.within)):
            raise ValueError(f"only_trained names {', '.join(unknown)}, which within does not list; add it there")
        return self

    def origin(self, name: str) -> str:
        """Return which of ``within`` an object's name begins with, or nothing."""
        return next((begin for begin in self.within if name.startswith(f"{begin}_")), "")


PairsParameter = Literal["all"] | Annotated[int, Field(ge=1)] | PartnersWithin | list[tuple[str, ...]]

LEAST, MOST = 0.5, 1.5  # partners of a second object, in parts of an even share


def partners(
    firsts: Sequence[str], seconds: Sequence[str], pairs: PairsParameter, seed: int
) -> dict[str, tuple[str, ...]]:
    """Return, for each first object, the objects that are picked after it, in the order of ``seconds``.

    Args:
        pairs: ``all``; or how many partners each first object gets; or the pairs themselves.
        seed: the run's; with a number of partners it decides which.

    No object is its own partner, unless the pairs themselves say so. Drawn partners are balanced: every second object
    has at least one, and between ``LEAST`` and ``MOST`` times an even share. And they are stable: one object more or
    fewer changes few pairs of the others, because every first object has an order of its own among the second ones,
    takes those that it prefers (rendezvous hashing, Thaler and Ravishankar 1998), and only those who have too few or
    too many are exchanged.
    """
    if pairs == "all":
        return {first: tuple(second for second in seconds if second != first) for first in firsts}
    if isinstance(pairs, PartnersWithin):
        return _within(firsts, seconds, pairs, seed)
    if isinstance(pairs, int):
        chosen = _drawn(firsts, seconds, min(pairs, len(seconds)), seed)
    else:
        named = set(pairs)
        chosen = np.array([[(first, second) in named for second in seconds] for first in firsts], dtype=bool)
    return {
        first: tuple(second for second, is_chosen in zip(seconds, row, strict=True) if is_chosen)
        for first, row in zip(firsts, chosen, strict=True)
    }


def _within(
    firsts: Sequence[str], seconds: Sequence[str], pairs: PartnersWithin, seed: int
) -> dict[str, tuple[str, ...]]:
    found: dict[str, tuple[str, ...]] = {}
    for begin in (*pairs.within, ""):
        own = [[name for name in names if pairs.origin(name) == begin] for names in (firsts, seconds)]
        found |= partners(own[0], own[1], pairs.partners, seed)
    return {first: found[first] for first in firsts}


def is_tried(first: str, pairs: PairsParameter) -> bool:
    """Return whether pairs that begin with an object are sampled and tried, and not merged for training alone."""
    return not isinstance(pairs, PartnersWithin) or pairs.origin(first) not in pairs.only_trained


def sequences(objects: Sequence[Sequence[str]], pairs: PairsParameter, seed: int) -> list[tuple[str, ...]]:
    """Return the objects of every sequence, in the order of ``objects``.

    Args:
        objects: those of each pick.
        pairs, seed: see :func:`partners`; a number is for two picks alone.
    """
    if len(objects) == 2:
        chosen = partners(objects[0], objects[1], pairs, seed)
        return [(first, second) for first, seconds in chosen.items() for second in seconds]
    if not isinstance(pairs, list):
        return list(product(*objects))
    places = [{name: place for place, name in enumerate(own)} for own in objects]
    return sorted(pairs, key=lambda names: [own[name] for own, name in zip(places, names, strict=True)])


def _drawn(firsts: Sequence[str], seconds: Sequence[str], count: int, seed: int) -> NDArray[np.bool_]:
    """Return which pairs (firsts, seconds) are drawn, ``count`` in each row."""
    liking = _scrambled(
        np.array([item_seed(seed, "first", name) for name in firsts], np.uint64)[:, None]
        ^ np.array([item_seed(seed, "second", name) for name in seconds], np.uint64)[None, :]
    )
    own = np.array(firsts)[:, None] == np.array(seconds)[None, :]
    liking[own] = np.iinfo(np.uint64).max
    taken = np.zeros(liking.shape, dtype=bool)
    np.put_along_axis(taken, np.argsort(liking, axis=1)[:, :count], True, axis=1)
    load, share = taken.sum(axis=0), len(firsts) * count / max(len(seconds), 1)
    for second in np.flatnonzero(load < max(1, math.floor(LEAST * share))):
        for first in np.argsort(liking[:, second]):
            held = np.flatnonzero(taken[first])
            richest = held[np.argmax(load[held])]
            if not taken[first, second] and load[richest] > share:
                _exchange(taken, load, first, richest, second)
            if load[second] >= max(1, math.floor(LEAST * share)):
                break
    for second in np.flatnonzero(load > math.ceil(MOST * share)):
        holders = np.flatnonzero(taken[:, second])
        for first in holders[np.argsort(liking[holders, second])[::-1]]:
            free = np.flatnonzero(~taken[first] & (load < share))
            if len(free):
                _exchange(taken, load, first, second, free[np.argmin(liking[first, free])])
            if load[second] <= math.ceil(MOST * share):
                break
    return taken & ~own


def _exchange(taken: NDArray[np.bool_], load: NDArray[np.int64], first: int, old: np.intp, new: np.intp) -> None:
    taken[first, old], taken[first, new] = False, True
    load[old] -= 1
    load[new] += 1


def _scrambled(values: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return numbers that look random (splitmix64, Steele, Lea and Flood 2014)."""
    with np.errstate(over="ignore"):
        values = (values ^ (values >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        values = (values ^ (values >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return values ^ (values >> np.uint64(31))
