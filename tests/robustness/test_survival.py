"""Conditions that a grasp must survive and ones that it cannot, the draw of conditions, and the lowest friction."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.physics.engine import GRAVITY
from pipeline.physics.holding import HeldGrasp
from pipeline.physics.world import make_world
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.robustness import RobustnessParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.records.poses import inverse_pose, transform_points
from pipeline.robustness.conditions import Condition, draw_conditions
from pipeline.robustness.contacts import GraspInHand, Grip
from pipeline.robustness.friction import lowest_friction, lowest_rung
from pipeline.robustness.measures import Measuring, margin_columns, physics_columns, survived_share
from pipeline.robustness.survival import displaced, opened, survived
from pipeline.shapes.distance_field import signed_distance
from pipeline.shapes.mass import weighted
from tests.physics.shapes import prepared_box
from tests.physics.test_holding import HAND, clamped_block
from tests.validate.test_validation import block_grasp

PHYSICS, LIMITS, SETTINGS = PhysicsParameters(), ValidateParameters(), RobustnessParameters()
ZERO = np.zeros((1, 3))
EASY = Condition(0.9, 0.7, np.ones(1), ZERO, ZERO, ZERO, ZERO, np.array([0.0, 0.0, -1.0]))


def block() -> tuple[GraspInHand, HeldGrasp]:
    _, candidate = block_grasp()
    q, squeeze_q, held = clamped_block()
    grip = Grip(held, candidate.fingers, candidate.contact_candidates)
    return GraspInHand(HAND, (grip,), q, squeeze_q), HeldGrasp((held,), q, squeeze_q, HAND)


def survives(**changes) -> bool:
    (outcome,) = survived(block()[0], [replace(EASY, **changes)], PHYSICS, LIMITS, SETTINGS)
    return outcome


def test_an_easy_condition_is_survived():
    assert survives()
    assert survives(position_errors=np.array([[0.0, 0.002, 0.003]]), mass_factors=np.array([2.0]))


@pytest.mark.parametrize(
    "changes",
    [
        {"friction": 0.0},
        {"mass_factors": np.array([1000.0])},  # far beyond any friction of fingers of 0.7 N m
        {"torque_limit": 1e-3},  # presses with 0.02 N or so
        {"position_errors": np.array([[0.0, 0.06, 0.0]])},  # the fingers close beside the block
        {"shoves": np.array([[0.0, 0.0, -100.0]])},
    ],
)
def test_a_condition_beyond_all_limits_is_not_survived(changes):
    assert not survives(**changes)


def test_a_push_accelerates_a_free_body_by_force_over_mass_and_is_then_forgotten():
    cube = prepared_box((0.04, 0.04, 0.04))
    world = make_world(PHYSICS, np.zeros(3))
    body = world.add_object(cube, np.eye(4), "cube")
    force, steps = np.array([0.1, -0.2, 0.3]), 20
    for _ in range(steps):
        body.push(force)
        world.step()
    pushed = body.pose[:3, 3]
    world.step(steps)
    velocity = force / cube.mass * steps / world.frequency
    np.testing.assert_allclose(body.pose[:3, 3] - pushed, velocity * steps / world.frequency, rtol=0.01)


def test_a_balanced_weight_floats():
    """What keeps the objects where they are while the hand closes."""
    cube = prepared_box((0.04, 0.04, 0.04))
    gravity = np.array([3.0, 0.0, -GRAVITY])
    world = make_world(PHYSICS, gravity)
    body = world.add_object(cube, np.eye(4), "cube")
    for _ in range(100):
        body.push(-cube.mass * gravity)
        world.step()
    np.testing.assert_allclose(body.pose, np.eye(4), atol=1e-5)  # free, it would have fallen 1.2 m


def test_opened_contacts_lie_outside_by_the_opening():
    grasp, _ = block()
    (grip,) = grasp.grips
    open_q = opened(grasp, 0.008)
    surface = displaced(grasp, open_q, EASY)
    np.testing.assert_allclose(surface[0], grip.held.T_hand_object)  # nothing in the way: it stays where it is
    own = grip.contact_candidates
    points = points_on_links(link_poses(HAND, open_q[None]), HAND.contact_link[own], HAND.contact_points[own])[0]
    found = signed_distance(grip.held.prepared, transform_points(inverse_pose(grip.held.T_hand_object), points))
    np.testing.assert_allclose(found, 0.008, atol=0.0015)


def test_a_displaced_object_is_turned_about_itself_and_gives_way_to_a_finger():
    grasp, _ = block()
    T = grasp.grips[0].held.T_hand_object
    turn = np.array([[0.0, 0.0, 0.3]])
    far = displaced(grasp, opened(grasp, 0.03), replace(EASY, rotation_errors=turn))[0]
    np.testing.assert_allclose(far[:3, 3], T[:3, 3], atol=1e-9)
    assert np.arccos((np.trace(T[:3, :3].T @ far[:3, :3]) - 1) / 2) == pytest.approx(0.3)
    # 5 mm into a finger that opened by 2 mm: it is pushed back by 3 mm, or the points of the surface miss the tip.
    near = displaced(grasp, opened(grasp, 0.002), replace(EASY, position_errors=np.array([[0.005, 0.0, 0.0]])))[0]
    moved = (near[:3, 3] - T[:3, 3]) @ T[:3, :3]
    assert 0.0015 < moved[0] < 0.0035


def test_conditions_are_the_same_for_the_same_objects_and_lie_in_their_ranges():
    many = SETTINGS.model_copy(update={"conditions": 4000})
    drawn = draw_conditions(many, 2, 1, "cube", "can")
    again = draw_conditions(SETTINGS, 2, 1, "cube", "can")
    other = draw_conditions(SETTINGS, 2, 1, "cube", "jar")
    assert [one.friction for one in again] == [one.friction for one in drawn[:16]]
    np.testing.assert_array_equal(again[15].shoves, drawn[15].shoves)
    assert again[0].friction != other[0].friction
    frictions = np.array([one.friction for one in drawn])
    assert 0.3 <= frictions.min() < 0.31 and 0.89 < frictions.max() <= 0.9
    assert frictions.mean() == pytest.approx(0.6, abs=0.01)
    masses = np.array([one.mass_factors for one in drawn])
    assert masses.shape == (4000, 2) and masses.min() >= 0.5 and masses.max() <= 2.0
    assert np.log(masses).mean() == pytest.approx(0.0, abs=0.03)
    centres = np.linalg.norm([one.centre_offsets for one in drawn], axis=2)
    assert centres.max() <= 0.01 and np.mean(centres < 0.005) == pytest.approx(1 / 8, abs=0.02)  # uniform in the ball
    gravity = np.array([one.gravity for one in drawn])
    np.testing.assert_allclose(np.linalg.norm(gravity, axis=1), 1.0)
    np.testing.assert_allclose(gravity.mean(0), 0.0, atol=0.04)
    assert np.linalg.norm([one.rotation_errors for one in drawn], axis=2).max() <= SETTINGS.distribution.rotation_error


@pytest.mark.parametrize("least", [0.95, 0.9, 0.65, 0.5, 0.41, 0.3, 0.1])
def test_the_lowest_rung_is_found_in_three_tests(least):
    tried = []

    def holds(friction: float) -> bool:
        tried.append(friction)
        return friction >= least

    holding = [friction for friction in SETTINGS.ladder if friction >= least]
    assert lowest_rung(holds, SETTINGS.ladder) == (holding[-1] if holding else np.inf)
    assert len(tried) <= 3


@pytest.mark.parametrize("friction", [0.3, 0.5])
def test_physics_loses_a_block_near_the_weight_that_the_margin_calls_the_largest(friction):
    """The margin is an upper bound, and close to the truth for two fingertips on opposite faces."""
    grasp, held = block()
    (margin,) = margin_columns(grasp, PHYSICS, SETTINGS.model_copy(update={"friction": friction}))

    def holds(share: float) -> bool:
        heavy = weighted(grasp.grips[0].held.prepared, share * margin["margin_mass_factor"], np.zeros(3))
        return (
            lowest_friction(
                replace(held, objects=(replace(held.objects[0], prepared=heavy),)), PHYSICS, LIMITS, [friction]
            )
            == friction
        )

    assert holds(0.7) and not holds(1.2)


def test_measures_left_out_by_the_settings_are_missing():
    grasp, held = block()
    off = SETTINGS.model_copy(update={"ladder": [], "conditions": 0})
    assert physics_columns(grasp, held, Measuring(off, ()), PHYSICS, LIMITS) == {}
    one = physics_columns(grasp, held, Measuring(off, (EASY,)), PHYSICS, LIMITS)
    assert one["robustness"] == 1.0 and set(one) == {"robustness", "robustness_low", "robustness_high"}


def test_the_interval_is_wilson_s():
    """12 of 16 by the formula: centre (p + z2/2n)/(1 + z2/n), z = 1.96."""
    found = survived_share([True] * 12 + [False] * 4)
    z2 = 1.959964**2
    centre, half = (0.75 + z2 / 32) / (1 + z2 / 16), np.sqrt(z2) / (1 + z2 / 16) * np.sqrt(0.1875 / 16 + z2 / 1024)
    assert found["robustness"] == 0.75
    assert found["robustness_low"] == pytest.approx(centre - half, abs=1e-6)
    assert found["robustness_high"] == pytest.approx(centre + half, abs=1e-6)
