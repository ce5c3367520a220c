"""Which combinations are tried, and in what order: random, balanced, and independent of who computes them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

Combination = tuple[int, int]  # positions in the two lists of single grasps


def random_order(
    first_count: int, second_count: int, generator: np.random.Generator, most: int | None = None
) -> list[Combination]:
    """Return the combinations of two lists, each once, in random order; at most ``most`` of them."""
    chosen = generator.permutation(first_count * second_count)[:most]
    return [(int(index) // second_count, int(index) % second_count) for index in chosen]


def next_combinations(
    pending: Sequence[Combination], accepted: Sequence[Combination], most_per_grasp: int, count: int
) -> tuple[list[Combination], list[Combination]]:
    """Take the next combinations such that no grasp can end up in more than ``most_per_grasp`` accepted ones.

    Args:
        pending: not yet tried, in order.
        accepted: those that passed so far.

    Returns:
        At most ``count`` combinations to try, and what remains pending, in order. Combinations met on the way whose
        grasps are used up are in neither, those that must wait for the outcome of the taken ones remain. What lies
        behind the last one taken is not looked at: there may be many.
    """
    used: tuple[Counter[int], Counter[int]] = Counter(a for a, _ in accepted), Counter(b for _, b in accepted)
    spent = used[0].copy(), used[1].copy()
    taken: list[Combination] = []
    waiting: list[Combination] = []
    for position, (first, second) in enumerate(pending):
        if len(taken) == count:
            return taken, [*waiting, *pending[position:]]
        if spent[0][first] >= most_per_grasp or spent[1][second] >= most_per_grasp:
            continue
        if used[0][first] < most_per_grasp and used[1][second] < most_per_grasp:
            taken.append((first, second))
            used[0][first] += 1
            used[1][second] += 1
        else:
            waiting.append((first, second))
    return taken, waiting
