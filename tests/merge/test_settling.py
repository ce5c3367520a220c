"""The pinched object in the squeezing fingers, by physics."""

from dataclasses import replace

import numpy as np

from pipeline.hand.allegro import load_hand
from pipeline.merge.clearance import hand_object_clearance, holding_links
from pipeline.merge.grasps import RING_JOINTS, join
from pipeline.merge.settling import settle_pinch
from pipeline.records.parameters.physics import PhysicsParameters
from tests.merge.constructed import box, pinch, side

SETTINGS = PhysicsParameters()


def test_squeezed_box_stays_between_the_tips() -> None:
    grasp = join(pinch(), side())
    settled = settle_pinch(grasp, box(), SETTINGS)
    shift = np.linalg.norm((settled.T_hand_held0 - grasp.T_hand_object0)[:3, 3])
    assert 0 < shift < 0.02
    for finger in ("thumb", "index"):
        links = holding_links(load_hand(), (finger,))
        distance = hand_object_clearance(settled.held_q, links, box(), settled.T_hand_held0)
        assert abs(distance) < 0.002  # still touching, and the solver keeps bodies apart
    np.testing.assert_array_equal(settled.held_q[RING_JOINTS], grasp.q[RING_JOINTS])
    np.testing.assert_array_equal(settled.q, grasp.q)  # the grasp itself is as validated


def test_without_squeeze_nothing_moves() -> None:
    grasp = join(replace(pinch(), squeeze_q=pinch().q), side())
    settled = settle_pinch(grasp, box(), SETTINGS)
    np.testing.assert_allclose(settled.T_hand_held0, grasp.T_hand_object0, atol=2e-3)
    np.testing.assert_allclose(settled.held_q, grasp.q, atol=0.02)


def test_settling_repeats_bit_for_bit() -> None:
    grasp = join(pinch(), side())
    first, second = (settle_pinch(grasp, box(), SETTINGS) for _ in range(2))
    assert first.T_hand_held0.tobytes() == second.T_hand_held0.tobytes()
    assert first.held_q.tobytes() == second.held_q.tobytes()
