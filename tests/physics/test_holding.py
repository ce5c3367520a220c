import numpy as np
import pytest

from pipeline.hand.kinematics import link_poses
from pipeline.hand.model import load_hand
from pipeline.hand.moves import finger_joints, move_points
from pipeline.physics.holding import (
    HeldObject,
    Outcome,
    gravity_vector,
    hold_in_gravities,
    holding_of,
    judge,
    rotation_angle,
)
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.validate import ValidateParameters
from tests.physics.shapes import prepared_box

SETTINGS = PhysicsParameters()
HAND = load_hand("allegro")


def test_gravity_directions_are_those_of_the_first_object() -> None:
    T = np.eye(4)
    T[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]  # object x is hand y
    np.testing.assert_allclose(gravity_vector("-x", T), [0, -9.81, 0])
    np.testing.assert_allclose(gravity_vector("+z", T), [0, 0, 9.81])


def test_rotation_angle() -> None:
    T = np.eye(4)
    T[:2, :2] = [[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]]
    assert rotation_angle(np.eye(4), T) == pytest.approx(0.4)


def clamped_block() -> tuple[np.ndarray, np.ndarray, HeldObject]:
    """Index and thumb tips on opposite faces of a thin block, found from their forward kinematics."""
    q = np.clip(np.array([0, 1.0, 0.75, 0.6] + [0, 1.5, 1.2, 1.0] * 2 + [1.396, 0.3, 0.3, 0.7]), HAND.lower, HAND.upper)
    poses = link_poses(HAND, q[None])[0]
    index, thumb = (poses[HAND.link(name)][:3, 3] for name in ("link_3.0_tip", "link_15.0_tip"))
    gap = np.linalg.norm(thumb - index)
    x = (thumb - index) / gap
    towards_palm = -(index + thumb) / 2
    z = towards_palm - (towards_palm @ x) * x  # object up
    z /= np.linalg.norm(z)
    T = np.eye(4)
    T[:3, :3] = np.stack([x, np.cross(z, x), z], 1)
    T[:3, 3] = (index + thumb) / 2
    width = float(gap - 2 * 0.012)
    assert width > 0.01
    held = HeldObject(prepared_box((width, 0.03, 0.03)), T, HAND.finger_links["index"] + HAND.finger_links["thumb"])
    links = [HAND.link("link_3.0_tip"), HAND.link("link_15.0_tip")]
    advance = 0.01 * np.stack([x, -x])
    squeeze = move_points(HAND, q, links, np.zeros((2, 3)), advance, finger_joints(["index", "thumb"], HAND))
    return q, squeeze, held


def test_squeezed_block_is_held_in_all_gravities_and_dropped_without_squeeze() -> None:
    q, squeeze, held = clamped_block()
    limits = ValidateParameters(early_rejection=False)
    good = hold_in_gravities(SETTINGS, limits, [held], q, squeeze, HAND)
    assert good.failed_direction == ""
    assert good.in_contact.all() and good.any_contact.all() and good.drift.max() < 0.02
    assert good.drift.shape == (6, 1)
    loose = hold_in_gravities(SETTINGS, limits, [held], q, q, HAND)
    assert loose.failed_direction == limits.gravity_directions[0]
    assert not loose.in_contact.all()
    early = hold_in_gravities(SETTINGS, ValidateParameters(), [held], q, q, HAND)
    assert early.directions == (limits.gravity_directions[0],) and early.steps < loose.steps


def test_two_objects_are_judged_separately() -> None:
    q, squeeze, held = clamped_block()
    T = np.eye(4)
    T[:3, 3] = 0.0, -0.3, 0.3  # beside the hand: falls
    other = HeldObject(prepared_box((0.03, 0.03, 0.03)), T, HAND.finger_links["ring"])
    limits = ValidateParameters(gravity_directions=["-z"])
    result = hold_in_gravities(SETTINGS, limits, [held, other], q, squeeze, HAND)
    assert result.in_contact.tolist() == [[True, False]]
    assert result.drift[0, 1] > 0.15 and result.failed_direction == "-z"


def test_repeats_bit_for_bit() -> None:
    q, squeeze, held = clamped_block()
    first, second = (hold_in_gravities(SETTINGS, ValidateParameters(), [held], q, squeeze, HAND) for _ in range(2))
    assert first.drift.tobytes() == second.drift.tobytes()


def test_drift_that_is_not_a_number_is_not_held() -> None:
    """Even when another object, named first, stays."""
    still, lost = (0.0, 0.0), (0.0, float("nan"))
    both = (True, True)
    limits = ValidateParameters()
    assert Outcome(still, still, both, both).held(limits)
    assert not Outcome(lost, still, both, both).held(limits)
    assert not Outcome(still, lost, both, both).held(limits)
    result = holding_of(["-x", "-z"], [Outcome(still, still, both, both), Outcome(lost, still, both, both)], limits, 2)
    assert result.failed_direction == "-z" and result.drift.shape == (2, 2)


def test_outcome_from_poses_and_pressing_links() -> None:
    _, _, held = clamped_block()
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(0.2), -np.sin(0.2)], [np.sin(0.2), np.cos(0.2)]]
    moved = held.T_hand_object @ turn  # about the object's own z
    moved[:3, 3] += [0.003, 0.0, 0.004]
    outcome = judge([held, held], [moved, held.T_hand_object], [{"link_7.0"}, set(held.assigned_links[:1])])
    np.testing.assert_allclose(outcome.drift, [0.005, 0.0], atol=1e-12)
    np.testing.assert_allclose(outcome.rotation, [0.2, 0.0], atol=1e-6)
    assert outcome.in_contact == (False, True) and outcome.any_contact == (True, True)
