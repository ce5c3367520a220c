"""The pinched object in the squeezing fingers, by physics."""

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.model import load_hand
from pipeline.hand.moves import finger_joints, straight
from pipeline.pairing.clearance import hand_object_clearance, holding_links, posed_hand
from pipeline.physics.settling import settle_grasp
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.poses import inverse_pose
from tests.merge.constructed import box, pinch

SETTINGS = PhysicsParameters()
HAND = load_hand("allegro")
RING = finger_joints(["ring"], HAND)


def settled(squeeze_q: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return settle_grasp(box(), inverse_pose(pinch().T_object_hand), pinch().q, squeeze_q, SETTINGS, ["ring"], HAND)


def test_squeezed_box_stays_between_the_tips() -> None:
    held_q, T_hand_held0 = settled(pinch().squeeze_q)
    shift = np.linalg.norm((T_hand_held0 - inverse_pose(pinch().T_object_hand))[:3, 3])
    assert 0 < shift < 0.02
    for finger in ("thumb", "index"):
        links = holding_links(HAND, (finger,))
        distance = hand_object_clearance(posed_hand(HAND, held_q), links, box(), T_hand_held0)
        assert abs(distance) < 0.002  # still touching, and the solver keeps bodies apart
    np.testing.assert_allclose(held_q[RING], straight(["ring"], HAND), atol=0.01)


def test_without_squeeze_nothing_moves() -> None:
    held_q, T_hand_held0 = settled(pinch().q)
    np.testing.assert_allclose(T_hand_held0, inverse_pose(pinch().T_object_hand), atol=2e-3)
    pinching = np.setdiff1d(np.arange(16), RING)
    np.testing.assert_allclose(held_q[pinching], pinch().q[pinching], atol=0.02)


def test_settling_repeats_bit_for_bit() -> None:
    first, second = (settled(pinch().squeeze_q) for _ in range(2))
    assert first[0].tobytes() == second[0].tobytes() and first[1].tobytes() == second[1].tobytes()
