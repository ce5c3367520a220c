"""Order and balance of the combinations."""

from collections import Counter

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pipeline.merge.draws import next_combinations, random_order


def test_random_order_holds_every_combination_once() -> None:
    order = random_order((5, 7), np.random.default_rng(0))
    assert sorted(order) == [(a, b) for a in range(5) for b in range(7)]
    assert order != sorted(order)
    assert order == random_order((5, 7), np.random.default_rng(0))
    assert random_order((0, 7), np.random.default_rng(0)) == []
    assert random_order((5, 7), np.random.default_rng(0), 6) == order[:6]


@given(
    firsts=st.integers(1, 6),
    seconds=st.integers(1, 6),
    most=st.integers(1, 3),
    count=st.integers(1, 10),
    seed=st.integers(0, 1000),
    pass_share=st.sampled_from([0.0, 0.4, 1.0]),
)
def test_no_grasp_is_used_too_often_and_nothing_is_tried_twice(
    firsts: int, seconds: int, most: int, count: int, seed: int, pass_share: float
) -> None:
    generator = np.random.default_rng(seed)
    pending = random_order((firsts, seconds), generator)
    accepted: list[tuple[int, int]] = []
    tried: list[tuple[int, int]] = []
    while True:
        taken, pending = next_combinations(pending, accepted, most, count)
        assert len(taken) <= count
        if not taken:
            break
        tried += taken
        accepted += [combination for combination in taken if generator.random() < pass_share]
    assert len(set(tried)) == len(tried)
    for position in (0, 1):
        assert max(Counter(c[position] for c in accepted).values(), default=0) <= most
    if pass_share == 0.0:
        assert len(tried) == firsts * seconds  # rejected combinations do not use a grasp up
    if pass_share == 1.0:
        # Nothing more could have been accepted: every remaining combination has a used-up grasp.
        used = [Counter(c[position] for c in accepted) for position in (0, 1)]
        for a in range(firsts):
            for b in range(seconds):
                assert (a, b) in accepted or used[0][a] == most or used[1][b] == most
