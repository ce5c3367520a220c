"""Margins against hand calculations of friction cones."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.physics.engine import GRAVITY
from pipeline.robustness.contacts import Grip, GripContacts, grip_contacts
from pipeline.robustness.margins import FRICTION_STEP, MOST_LOAD, JointLimits, largest_loads, margins, slides
from tests.physics.test_holding import HAND, clamped_block
from tests.validate.test_validation import block_grasp

HALF, LEVER, TORQUE, RADIUS = 0.02, 0.1, 0.7, 0.003
PRESS = TORQUE / LEVER  # N, what one joint with that lever can press
LIMITS = JointLimits(TORQUE, RADIUS)
MASS = 0.1


def between_finger_and_palm(tilt: float = 0.0) -> GripContacts:
    """A finger of one joint presses a block along +x against a palm; ``tilt``, rad, turns both normals towards -z.

    The joint's axis is y, ``LEVER`` below the contact, so that it moves along x and bears no other force.
    """
    points = np.array([[-HALF, 0, 0], [HALF, 0, 0]])
    inward = np.array([[np.cos(tilt), 0, -np.sin(tilt)], [-np.cos(tilt), 0, -np.sin(tilt)]])
    jacobians = np.zeros((2, 3, 1))
    jacobians[0, 0, 0] = LEVER
    return GripContacts(points, inward, jacobians)


def test_friction_of_both_sides_carries_the_weight():
    found = margins(between_finger_and_palm(), MASS, 0.3, LIMITS)
    assert found.mass_factor == pytest.approx(2 * 0.3 * PRESS / (MASS * GRAVITY))  # less than the finger's own press
    needed = MASS * GRAVITY / (2 * PRESS)
    assert needed <= found.lowest_friction < needed + 2 * FRICTION_STEP


def test_the_finger_s_own_press_carries_the_weight_where_friction_is_ample():
    """Gravity away from the palm: the finger alone pushes back, the palm lets go."""
    assert margins(between_finger_and_palm(), MASS, 0.9, LIMITS).mass_factor == pytest.approx(PRESS / MASS / GRAVITY)


def test_a_push_between_the_axes_is_harder_to_bear():
    """Along (-1, 1, 1): the palm yields as the finger pushes back, and both must carry half of the rest (moments)."""
    friction = 0.3
    push = 2 * friction * PRESS / (np.sqrt(2 / 3) + 2 * friction / np.sqrt(3))
    found = margins(between_finger_and_palm(), MASS, friction, LIMITS)
    assert found.push_force == pytest.approx(push)


def test_two_contacts_bear_little_torque_about_the_line_between_them():
    friction = 0.3
    found = margins(between_finger_and_palm(), MASS, friction, LIMITS)
    assert found.push_torque == pytest.approx(2 * friction * RADIUS * PRESS)
    without = margins(between_finger_and_palm(), MASS, friction, replace(LIMITS, torsion_radius=0.0))
    assert without.push_torque == 0.0


def test_sliding_and_turning_share_the_friction():
    """At 45 degrees on the ellipsoid of sliding and turning, where the hull has a corner."""
    friction, both = 0.3, np.sqrt(0.5)
    load = np.array([[0, 0, 2 * friction * PRESS, 2 * friction * PRESS * RADIUS, 0, 0]])
    assert largest_loads(between_finger_and_palm(), load, friction, LIMITS)[0] == pytest.approx(both)


@pytest.mark.parametrize("tilt", [0.2, 0.4])
def test_a_wedge_slips_out_below_the_tangent_of_its_angle(tilt):
    strong = JointLimits(1e4 * TORQUE, RADIUS)  # the weight counts for nothing beside the squeeze
    found = margins(between_finger_and_palm(tilt), MASS, 0.5, strong)
    assert np.tan(tilt) <= found.lowest_friction < np.tan(tilt) + 2 * FRICTION_STEP
    assert margins(between_finger_and_palm(tilt), MASS, np.tan(tilt) - 0.01, strong).mass_factor == pytest.approx(0)


def test_a_block_that_lies_on_the_palm_alone_is_not_held():
    contacts = between_finger_and_palm()
    palm = GripContacts(contacts.points[1:], contacts.inward[1:], contacts.jacobians[1:])
    found = margins(palm, MASS, 0.5, LIMITS)
    assert found.mass_factor == 0.0 and found.lowest_friction == np.inf
    assert largest_loads(palm, np.array([[1.0, 0, 0, 0, 0, 0]]), 0.5, LIMITS)[0] == pytest.approx(MOST_LOAD)


def test_weight_beside_the_line_between_the_contacts_hangs_on_torsion():
    """A centre of mass 10 mm off: gravity along y turns the block about x."""
    contacts = between_finger_and_palm()
    beside = replace(contacts, points=contacts.points - [0.0, 0.0, 0.01])
    load = np.array([[0, 1.0, 0, 0, 0, 0]])
    friction = 0.3
    # Force F and moment 0.01 F about x at once: F / (2 mu N) = s, 0.01 F / (2 mu N r) = t, s2 + t2 = 1.
    ratio = 0.01 / RADIUS
    bound = 2 * friction * PRESS / np.sqrt(1 + ratio**2)
    borne = largest_loads(beside, load, friction, LIMITS)[0]
    assert 0.81 * bound <= borne <= bound * (1 + 1e-9)


def test_the_hull_of_friction_lies_within_the_ball_by_as_much_as_stated():
    hull = ConvexHull(slides())
    assert np.linalg.norm(slides(), axis=1) == pytest.approx(1.0)
    assert 0.81 <= -hull.equations[:, 3].max() <= 1.0
    ring = ConvexHull(slides()[:8, :2])
    assert -ring.equations[:, 2].max() == pytest.approx(np.cos(np.pi / 8))  # 0.92


def test_contacts_move_with_the_joints_as_their_jacobians_say():
    prepared, candidate = block_grasp()
    _, _, held = clamped_block()
    grip = Grip(held, candidate.fingers, candidate.contact_candidates)
    found = grip_contacts(grip, candidate.q, HAND)
    np.testing.assert_allclose(found.inward, [[1, 0, 0], [-1, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(np.abs(found.points[:, 0]), prepared.extents[0] / 2, atol=0.001)

    def points(q: np.ndarray) -> np.ndarray:
        own = candidate.contact_candidates
        in_hand = points_on_links(link_poses(HAND, q[None]), HAND.contact_link[own], HAND.contact_points[own])[0]
        return (in_hand - held.T_hand_object[:3, 3]) @ held.T_hand_object[:3, :3]

    step = 1e-6
    for joint in range(HAND.joint_count):
        moved = candidate.q.copy()
        moved[joint] += step
        expected = (points(moved) - points(candidate.q)) / step
        np.testing.assert_allclose(found.jacobians[:, :, joint], expected, atol=1e-6)
