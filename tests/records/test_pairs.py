"""Which pairs there are: all, a number of partners, or a list."""

from collections import Counter

import pytest

from pipeline.records.parameters.pairs import LEAST, MOST, PartnersWithin, is_tried, partners

FIRSTS = [f"first_{number}" for number in range(120)]
SECONDS = [f"second_{number}" for number in range(80)]


def pairs_of(*arguments) -> set[tuple[str, str]]:
    return {(first, second) for first, own in partners(*arguments).items() for second in own}


def test_all_pairs_and_a_list():
    assert partners(["a", "b"], ["c", "d"], "all", 1) == {"a": ("c", "d"), "b": ("c", "d")}
    assert partners(["a", "b"], ["c", "d"], [("b", "d"), ("b", "c")], 1) == {"a": (), "b": ("c", "d")}


@pytest.mark.parametrize("count", [1, 4, 10])
def test_every_first_object_has_so_many_and_second_ones_an_even_share(count):
    drawn = partners(FIRSTS, SECONDS, count, seed=3)
    assert {len(set(own)) for own in drawn.values()} == {count}
    load = Counter(second for own in drawn.values() for second in own)
    share = len(FIRSTS) * count / len(SECONDS)
    assert set(load) == set(SECONDS)
    assert max(1, int(LEAST * share)) <= min(load.values())
    assert max(load.values()) <= MOST * share + 1


def test_more_partners_than_there_are_means_all():
    assert partners(["a"], ["c", "d"], 5, 1) == {"a": ("c", "d")}
    assert partners(["a"], [], 5, 1) == {"a": ()}
    assert partners([], ["c"], 5, 1) == {}


def test_the_seed_decides():
    assert pairs_of(FIRSTS, SECONDS, 4, 1) == pairs_of(FIRSTS, SECONDS, 4, 1)
    assert pairs_of(FIRSTS, SECONDS, 4, 1) != pairs_of(FIRSTS, SECONDS, 4, 2)


@pytest.mark.parametrize(
    ("firsts", "seconds"),
    [
        ([*FIRSTS, "new"], SECONDS),
        (FIRSTS, [*SECONDS, "new"]),
        (FIRSTS[:50] + FIRSTS[51:], SECONDS),
        (FIRSTS, SECONDS[:50] + SECONDS[51:]),
    ],
)
def test_one_object_more_or_fewer_leaves_most_pairs_of_the_others(firsts, seconds):
    before, after = pairs_of(FIRSTS, SECONDS, 4, 1), pairs_of(firsts, seconds, 4, 1)
    kept = {(first, second) for first, second in before if first in firsts and second in seconds}
    assert len(kept - after) < 0.05 * len(before)


def test_partners_come_from_the_same_origin():
    firsts = [*FIRSTS, *(f"ycb_{number}" for number in range(10)), "ycbx_1"]
    seconds = [*SECONDS, *(f"ycb_{number}" for number in range(5, 20))]
    drawn = partners(firsts, seconds, PartnersWithin(partners=3, within=["ycb"]), 1)
    assert list(drawn) == firsts and {len(own) for own in drawn.values()} == {3}
    for first, own in drawn.items():
        assert {second.startswith("ycb_") for second in own} == {first.startswith("ycb_")}
    assert {first: own for first, own in drawn.items() if not first.startswith("ycb_")} == partners(
        [*FIRSTS, "ycbx_1"], SECONDS, 3, 1
    )


def test_pairs_for_training_alone_are_not_tried():
    chosen = PartnersWithin(partners=1, within=["ycb", "block"], only_trained=["block"])
    assert [is_tried(name, chosen) for name in ("ycb_1", "block_2", "blocks", "cube")] == [True, False, True, True]
    assert is_tried("block_2", "all") and is_tried("block_2", 3)
    with pytest.raises(ValueError, match="only_trained names other"):
        PartnersWithin(partners=1, within=["ycb"], only_trained=["other"])


@pytest.mark.parametrize("pairs", ["all", 2, PartnersWithin(partners=2, within=["ycb"])])
def test_no_object_is_its_own_partner(pairs):
    names = [*FIRSTS[:5], *(f"ycb_{number}" for number in range(5))]
    drawn = partners(names, names, pairs, 1)
    assert all(first not in own for first, own in drawn.items())
    assert min(len(own) for own in drawn.values()) >= 2
    assert partners(["a"], ["a"], [("a", "a")], 1) == {"a": ("a",)}
