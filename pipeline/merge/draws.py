"""Which combinations are tried, and in what order: random, balanced, and independent of who computes them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

Combination = tuple[int, ...]  # positions in the lists of single grasps, one list per object


def random_order(counts: Sequence[int], generator: np.random.Generator, most: int | None = None) -> list[Combination]:
    """Return the combinations of lists of these lengths, each once, in random order; at most ``most`` of them."""
    chosen = generator.permutation(int(np.prod(counts)))[:most]
    return [tuple(int(index) for index in indices) for indices in np.stack(np.unravel_index(chosen, counts), axis=1)]


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
    used = Counter(grasp for combination in accepted for grasp in enumerate(combination))
    spent = used.copy()
    taken: list[Combination] = []
    waiting: list[Combination] = []
    for position, combination in enumerate(pending):
        grasps = list(enumerate(combination))
        if len(taken) == count:
            return taken, [*waiting, *pending[position:]]
        if any(spent[grasp] >= most_per_grasp for grasp in grasps):
            continue
        if all(used[grasp] < most_per_grasp for grasp in grasps):
            taken.append(combination)
            used.update(grasps)
        else:
            waiting.append(combination)
    return taken, waiting
