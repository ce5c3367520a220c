"""Which points a style of grasp is judged by."""

import numpy as np
import pytest

from pipeline.hand.model import load_hand
from pipeline.hand.parts import part_points

HAND = load_hand("allegro")
REST = np.full(16, 0.3)


@pytest.mark.parametrize(("style", "moved_by"), [("pinch", {"index", "middle", "thumb"}), ("side", {"ring"})])
def test_only_the_fingers_of_the_style_move_its_points(style, moved_by):
    at_rest = part_points(style, REST, HAND)
    for finger, joints in HAND.finger_joints.items():
        q = REST.copy()
        q[list(joints)] += 0.2
        moved = np.linalg.norm(part_points(style, q, HAND) - at_rest, axis=1).max()
        assert (moved > 0.005) == (finger in moved_by), finger


def test_palm_belongs_to_both_and_every_point_to_one_at_least():
    pinch, side = part_points("pinch", REST, HAND), part_points("side", REST, HAND)
    both = [point for point in pinch if (np.abs(side - point).max(1) < 1e-12).any()]
    assert len(both) > 0 and len(pinch) + len(side) - len(both) == 300
