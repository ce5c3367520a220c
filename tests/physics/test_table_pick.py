from dataclasses import replace

import numpy as np

from pipeline.hand.approach import Approach
from pipeline.hand.moves import finger_joints, move_points
from pipeline.physics.holding import HeldGrasp
from pipeline.physics.table_pick import TablePick, pick_from_support
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.validate import ValidateParameters
from tests.physics.test_holding import HAND, SETTINGS, clamped_block

LIMITS = ValidateParameters()


def pick(squeeze: bool, opening: float, lower: float = 0.0) -> TablePick:
    """The clamped block stands upright between index and thumb; the hand comes from above."""
    q, squeeze_q, held = clamped_block()
    T = held.T_hand_object
    prepared: PreparedObject = held.prepared
    if lower:
        prepared = replace(prepared, vertices=prepared.vertices + [0, 0, lower])
    R = T[:3, :3]
    links = [HAND.link("link_3.0_tip"), HAND.link("link_15.0_tip")]
    outward = opening * np.stack([-R[:, 0], R[:, 0]])
    open_q = move_points(HAND, q, links, np.zeros((2, 3)), outward, finger_joints(["index", "thumb"]))
    grasp = HeldGrasp((replace(held, prepared=prepared),), q, squeeze_q if squeeze else q, HAND)
    approach = Approach(open_q, np.array([0.0, 0.0, 1.0]), 0.05, penetrations=0, clearance=0.0)
    return pick_from_support(SETTINGS, LIMITS, grasp, np.linalg.inv(T), approach)


def test_block_is_picked_with_a_squeeze_and_left_without() -> None:
    good = pick(squeeze=True, opening=0.012)
    assert good.failure(LIMITS) == ""
    assert good.push < 0.002
    bad = pick(squeeze=False, opening=0.012)
    assert bad.failure(LIMITS) == "drop"


def test_failures_are_named_in_order() -> None:
    fine = TablePick(push=0.0, touched_support=False, drift=0.0, rotation=0.0, in_contact=True)
    assert fine.failure(LIMITS) == ""
    assert replace(fine, push=0.1, in_contact=False).failure(LIMITS) == "push"
    assert replace(fine, touched_support=True, in_contact=False).failure(LIMITS) == "touch"
    assert replace(fine, in_contact=False).failure(LIMITS) == "drop"
    assert replace(fine, drift=0.03).failure(LIMITS) == "drift"
    assert replace(fine, rotation=1.0).failure(LIMITS) == "drift"


def test_a_motion_that_is_not_a_number_fails() -> None:
    fine = TablePick(push=0.0, touched_support=False, drift=0.0, rotation=0.0, in_contact=True)
    assert replace(fine, push=float("nan")).failure(LIMITS) == "push"
    assert replace(fine, drift=float("nan")).failure(LIMITS) == "drift"
