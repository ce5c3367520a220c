import numpy as np
import pytest

from pipeline.hand.kinematics import link_poses
from pipeline.hand.model import load_hand
from pipeline.hand.moves import finger_joints, move_points
from pipeline.physics import holding
from pipeline.physics.engine import World
from pipeline.physics.holding import (
    HeldObject,
    Outcome,
    gravity_vector,
    hold_in_gravities,
    holding_of,
    judge,
    rotation_angle,
)
from pipeline.physics.world import make_world
from pipeline.records.errors import UserError
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.validate import ValidateParameters
from tests.physics.engines import in_both, settings
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


@in_both
def test_squeezed_block_is_held_in_all_gravities_and_dropped_without_squeeze(engine: str) -> None:
    q, squeeze, held = clamped_block()
    limits = ValidateParameters(early_rejection=False)
    physics = settings(engine)
    good = hold_in_gravities(physics, limits, [held], q, squeeze, HAND)
    assert good.failed_direction == ""
    assert good.in_contact.all() and good.any_contact.all() and good.drift.max() < 0.02
    assert good.drift.shape == (6, 1)
    loose = hold_in_gravities(physics, limits, [held], q, q, HAND)
    assert loose.failed_direction == limits.gravity_directions[0]
    assert not loose.in_contact.all()
    early = hold_in_gravities(physics, ValidateParameters(), [held], q, q, HAND)
    assert early.directions == (limits.gravity_directions[0],) and early.steps < loose.steps


@in_both
def test_two_objects_are_judged_separately(engine: str) -> None:
    q, squeeze, held = clamped_block()
    T = np.eye(4)
    T[:3, 3] = 0.0, -0.3, 0.3  # beside the hand: falls
    other = HeldObject(prepared_box((0.03, 0.03, 0.03)), T, HAND.finger_links["ring"])
    limits = ValidateParameters(gravity_directions=["-z"])
    result = hold_in_gravities(settings(engine), limits, [held, other], q, squeeze, HAND)
    assert result.in_contact.tolist() == [[True, False]]
    assert result.drift[0, 1] > 0.15 and result.failed_direction == "-z"


@in_both
def test_repeats_bit_for_bit(engine: str) -> None:
    q, squeeze, held = clamped_block()
    limits = ValidateParameters(gravity_directions=["-x", "+y"])
    first, second = (hold_in_gravities(settings(engine), limits, [held], q, squeeze, HAND) for _ in range(2))
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


def test_held_in_both_engines_means_in_each() -> None:
    still, moved = (0.001, 0.002), (0.003, 0.001)
    worse = Outcome(still, moved, (True, False), (True, True)).worse(Outcome(moved, still, (True, True), (False, True)))
    assert worse == Outcome((0.003, 0.002), (0.003, 0.002), (True, False), (False, True))
    lost = Outcome((float("nan"), 0.0), still, (True, True), (True, True))
    good = Outcome(still, still, (True, True), (True, True))
    limits = ValidateParameters()
    assert not lost.worse(good).held(limits) and not good.worse(lost).held(limits) and good.worse(good).held(limits)


@pytest.mark.parametrize("dropped_by", ["sapien", "mujoco", ""])
def test_a_grasp_passes_only_where_both_engines_hold_it(dropped_by: str, monkeypatch) -> None:
    """One engine is given a hand that does not squeeze."""
    q, squeeze, held = clamped_block()
    limits = ValidateParameters(gravity_directions=["-x"], early_rejection=True)
    make = holding.make_world

    def make_some_weak(physics: PhysicsParameters, gravity: np.ndarray) -> World:
        weak = {"hand_torque_limit": 1e-3} if physics.engine == dropped_by else {}
        return make(physics.model_copy(update=weak), gravity)

    monkeypatch.setattr(holding, "make_world", make_some_weak)
    result = hold_in_gravities(settings("both"), limits, [held], q, squeeze, HAND)
    assert result.failed_direction == ("-x" if dropped_by else "")
    assert result.in_contact.tolist() == [[not dropped_by]]


def test_a_world_is_of_one_engine() -> None:
    with pytest.raises(UserError, match="set physics.engine to sapien or mujoco"):
        make_world(settings("both"))
