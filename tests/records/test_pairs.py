"""Which objects are picked one after the other."""

from collections import Counter

import pytest

from pipeline.records.parameters.pairs import EXCESS, partners


def names(letter: str, count: int) -> list[str]:
    return [f"{letter}{index}" for index in range(count)]


def test_all_pairs_and_listed_pairs_are_in_the_order_of_the_styles() -> None:
    assert partners(["a", "b"], ["x", "y"], "all", 1) == {"a": ("x", "y"), "b": ("x", "y")}
    assert partners(["a", "b"], ["x", "y"], [("b", "y"), ("b", "x")], 1) == {"a": (), "b": ("x", "y")}


@pytest.mark.parametrize(("firsts", "seconds", "count"), [(8, 8, 4), (100, 60, 4), (60, 100, 3), (40, 7, 5), (1, 9, 1)])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_drawn_partners_are_spread_evenly(firsts: int, seconds: int, count: int, seed: int) -> None:
    found = partners(names("a", firsts), names("b", seconds), count, seed)
    load = Counter(second for own in found.values() for second in own)
    assert list(found) == names("a", firsts)
    assert all(len(set(own)) == len(own) for own in found.values())
    assert set(load) == set(names("b", seconds))  # nobody is left out
    share = firsts * count / seconds
    if share >= 1:
        assert max(load.values()) <= EXCESS * share + 1
        assert sum(load.values()) <= firsts * count + seconds  # those left out at first are given to somebody


def test_more_partners_than_there_are_is_all_of_them() -> None:
    assert partners(["a"], ["x", "y"], 5, 1) == partners(["a"], ["x", "y"], "all", 1)


def test_the_seed_decides_who_is_drawn() -> None:
    args = names("a", 20), names("b", 20), 3
    assert partners(*args, 1) == partners(*args, 1)
    assert partners(*args, 1) != partners(*args, 2)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_one_more_first_object_changes_few_partners(seed: int) -> None:
    seconds = names("b", 50)
    before, after = (partners(names("a", count), seconds, 4, seed) for count in (100, 101))
    changed = sum(before[name] != after[name] for name in before)
    assert changed <= 20  # 13 where the bound itself grows, else hardly any; by another draw of all, nearly every one
