import numpy as np
import pytest

from pipeline.hand.approach import Approach
from pipeline.hand.moves import finger_joints, move_points
from pipeline.physics.holding import HeldGrasp
from pipeline.physics.table_pick import TablePick, pick_from_support
from pipeline.records.parameters.validate import ValidateParameters
from tests.physics.engines import settings
from tests.physics.test_holding import HAND, clamped_block

LIMITS = ValidateParameters()


def pick(engine: str, squeeze: bool, opening: float) -> TablePick:
    """The clamped block stands upright between index and thumb; the hand comes from above."""
    q, squeeze_q, held = clamped_block()
    T = held.T_hand_object
    R = T[:3, :3]
    links = [HAND.link("link_3.0_tip"), HAND.link("link_15.0_tip")]
    outward = opening * np.stack([-R[:, 0], R[:, 0]])
    open_q = move_points(HAND, q, links, np.zeros((2, 3)), outward, finger_joints(["index", "thumb"], HAND))
    grasp = HeldGrasp((held,), q, squeeze_q if squeeze else q, HAND)
    approach = Approach(open_q, np.array([0.0, 0.0, 1.0]), 0.05, penetrations=0, clearance=0.0)
    return pick_from_support(settings(engine), LIMITS, grasp, np.linalg.inv(T), approach)


@pytest.mark.parametrize("engine", ["sapien", "mujoco", "both"])
def test_block_is_picked_with_a_squeeze_and_left_without(engine: str) -> None:
    good = pick(engine, squeeze=True, opening=0.012)
    assert good.in_contact and not good.touched_support
    assert good.push < 0.002 and good.drift < LIMITS.drift_limit and good.rotation < LIMITS.rotation_limit
    bad = pick(engine, squeeze=False, opening=0.012)
    assert not bad.in_contact
