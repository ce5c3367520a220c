"""Joining of two grasps."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.pairing.grasps import distinct_grasps, fingers_fit, fingers_of, join
from tests.merge.constructed import GROUPS, HAND, pinch, side


def test_join_takes_the_ring_from_the_second_grasp_and_everything_else_from_the_first() -> None:
    first = replace(pinch(), q=np.arange(16.0), squeeze_q=np.arange(16.0) + 100)
    second = replace(side(), q=-np.arange(16.0), squeeze_q=-np.arange(16.0) - 100)
    merged = join(HAND, [first, second], GROUPS)
    assert merged.q.tolist() == [0, 1, 2, 3, 4, 5, 6, 7, -8, -9, -10, -11, 12, 13, 14, 15]
    expected = [100, 101, 102, 103, 104, 105, 106, 107, -108, -109, -110, -111, 112, 113, 114, 115]
    assert merged.squeeze_q.tolist() == expected
    np.testing.assert_allclose(merged.T_hand_object[0] @ first.T_object_hand, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(merged.T_hand_object[1] @ second.T_object_hand, np.eye(4), atol=1e-12)


@pytest.mark.parametrize(
    ("first", "second", "disjoint"),
    [
        (("thumb", "index"), ("ring", "palm"), True),
        (("thumb", "index", "middle"), ("ring", "palm"), True),
        (("thumb",), ("ring", "palm"), False),  # one finger does not pinch
        (("thumb", "palm"), ("ring", "palm"), False),
        (("thumb", "ring"), ("ring", "palm"), False),
        (("thumb", "index"), ("ring",), False),
        (("thumb", "index"), ("ring", "palm", "middle"), False),
    ],
)
def test_fingers_of_a_pair_are_those_of_its_groups(
    first: tuple[str, ...], second: tuple[str, ...], disjoint: bool
) -> None:
    assert fingers_fit([replace(pinch(), fingers=first), replace(side(), fingers=second)], GROUPS) is disjoint


def test_the_palm_may_hold_several_objects_but_a_finger_only_one() -> None:
    middle = replace(side(), fingers=("middle", "palm"))
    groups = (("thumb", "index"), ("middle", "palm"), ("ring", "palm"))
    assert fingers_fit([pinch(), middle, side()], groups)
    assert not fingers_fit([pinch(), side(), side()], (("thumb", "index"), ("ring", "palm"), ("ring", "palm")))
    assert not fingers_fit([replace(pinch(), fingers=("thumb", "middle")), middle, side()], groups)


def test_join_of_three_takes_from_each_the_fingers_of_its_group() -> None:
    singles = [replace(single, q=np.full(16, float(value))) for value, single in enumerate((pinch(), side(), side()))]
    joined = join(HAND, singles, (("thumb", "index"), ("middle", "palm"), ("ring", "palm")))
    assert joined.q.tolist() == [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 0, 0, 0, 0]
    assert fingers_of(joined.groups) == ("thumb", "index", "middle", "ring")
    np.testing.assert_array_equal(joined.posture(1)[8:12], HAND.straight["ring"])
    np.testing.assert_array_equal(joined.posture(2), joined.held_q)


def test_near_repetitions_of_a_grasp_are_dropped() -> None:
    moved = [side().T_object_hand.copy() for _ in range(3)]
    moved[1][0, 3] += 0.002
    moved[2][0, 3] += 0.004
    grasps = [replace(side(), grasp_id=index, T_object_hand=T) for index, T in enumerate(moved)]
    assert [grasp.grasp_id for grasp in distinct_grasps(HAND, grasps, GROUPS, 1, 0.003)] == [0, 2]
    assert len(distinct_grasps(HAND, grasps, GROUPS, 1, 0.0)) == 3


def test_posture_of_fingers_that_are_not_taken_over_does_not_make_a_grasp_distinct() -> None:
    q = side().q.copy()
    q[:4] += 0.3  # the index finger of a side grasp
    assert len(distinct_grasps(HAND, [side(), replace(side(), q=q)], GROUPS, 1, 0.001)) == 1
    ring = side().q.copy()
    ring[8:12] += 0.1
    assert len(distinct_grasps(HAND, [side(), replace(side(), q=ring)], GROUPS, 1, 0.001)) == 2
