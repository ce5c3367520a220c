"""Exact scores against closed forms; what the filter says."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.energy.arrays import block_order, torque_scale
from pipeline.energy.contacts import contact_shares, contact_slots, force_closure
from pipeline.energy.scene import Grasps
from pipeline.hand.model import load_hand
from pipeline.records.energy_terms import COLUMNS, Terms
from pipeline.records.errors import UserError
from pipeline.records.parameters.synthesize import EnergyParameters
from pipeline.synthesize.scoring import ExactSurface, duplicates, first_failures
from tests.synthesize import shapes

HAND = load_hand("allegro")
HALF = np.array([0.02, 0.03, 0.04])


def first_candidate(finger: str) -> int:
    return HAND.contact_finger.index(finger)


def test_distance_to_a_box_has_its_closed_form():
    points = np.random.default_rng(0).uniform(-0.08, 0.08, (500, 3))
    surface = ExactSurface(shapes.box(extents=tuple(2 * HALF)))
    distance, normals = surface.distance_and_normal(points)
    np.testing.assert_allclose(distance, shapes.box_distance(HALF)(points), atol=1e-7)
    outside = distance > 1e-4
    away = points - np.clip(points, -HALF, HALF)
    expected = away[outside] / np.linalg.norm(away[outside], axis=1, keepdims=True)
    np.testing.assert_allclose(normals[outside], expected, atol=2e-3)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-6)


def test_normals_inside_and_on_the_surface_point_outwards():
    points = np.array([[0.018, 0.0, 0.0], [0.0, -0.03, 0.0], [0.0, 0.005, 0.04]])
    distance, normals = ExactSurface(shapes.box(extents=tuple(2 * HALF))).distance_and_normal(points)
    np.testing.assert_allclose(distance, [-0.002, 0, 0], atol=1e-7)
    np.testing.assert_allclose(normals, [[1, 0, 0], [0, -1, 0], [0, 0, 1]], atol=1e-4)


def test_force_closure_of_textbook_grasps():
    x, ones = np.array([1.0, 0, 0]), np.ones((1, 2))
    antipodal = force_closure(np.array([[0.02 * x, -0.02 * x]]), np.array([[x, -x]]), ones, 50.0)
    assert antipodal == pytest.approx(0)
    single = force_closure(np.array([[0.02 * x]]), np.array([[x]]), np.ones((1, 1)), 50.0)
    assert single == pytest.approx(1)
    # Opposite forces whose lines are d apart: a couple of moment d, nothing else.
    d = np.array([0, 0.01, 0])
    for scale in (1.0, 50.0):
        couple = force_closure(np.array([[0.02 * x + d, -0.02 * x]]), np.array([[x, -x]]), ones, scale)
        assert couple == pytest.approx((scale * 0.01) ** 2)
    angles = 2 * np.pi * np.arange(3) / 3
    star = np.stack([np.cos(angles), np.sin(angles), 0 * angles], -1)[None]
    assert force_closure(0.03 * star, star, np.ones((1, 3)), 50.0) == pytest.approx(0)


def test_balanced_groups_close_what_unit_forces_cannot():
    contacts = np.array([[first_candidate("thumb"), first_candidate("index"), first_candidate("middle")]])
    z = np.array([0, 0, 1.0])
    points = np.array([[-0.02 * z, 0.02 * z, 0.02 * z]])
    normals = np.array([[-z, z, z]])
    balanced, unit = contact_shares(HAND, contacts, True), contact_shares(HAND, contacts, False)
    np.testing.assert_allclose(balanced, [[1.5, 0.75, 0.75]])
    assert force_closure(points, normals, balanced, 1.0) == pytest.approx(0)
    assert force_closure(points, normals, unit, 1.0) == pytest.approx(1)
    # Without an opponent there is nothing to balance.
    np.testing.assert_allclose(contact_shares(HAND, contacts[:, 1:], True), 1)


def test_torques_are_measured_in_half_middle_extents():
    assert torque_scale(np.array([0.1, 0.04, 0.05]), True) == pytest.approx(1 / 0.025)
    assert torque_scale(np.array([0.1, 0.04, 0.05]), False) == 1.0


def terms(**values: float) -> Terms:
    return Terms(**{name: np.array([values.get(name, 0.0)]) for name in COLUMNS})


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({}, ""),
        ({"energy": 100.0}, ""),
        ({"joints": 0.01, "distance": 1, "force_closure": 1}, "joints"),
        ({"distance": 0.006, "force_closure": 1}, "distance"),
        ({"force_closure": 0.31, "penetration": 1}, "force_closure"),
        ({"penetration": 0.0011, "table": 1, "self_penetration": 1}, "penetration"),
        ({"penetration": 0.0006, "table": 0.0006, "self_penetration": 1}, "table"),
        ({"self_penetration": 0.0011}, "self_penetration"),
    ],
)
def test_first_failed_check_is_named(values, reason):
    assert first_failures(terms(**values), EnergyParameters()).tolist() == [reason]


def test_terms_without_a_limit_are_not_filtered_unless_they_are_no_number():
    energy = EnergyParameters(limit_joints=None, limit_self_penetration=None)
    assert first_failures(terms(joints=3.0, self_penetration=3.0), energy)[0] == ""
    assert first_failures(terms(joints=float("nan")), energy)[0] == "joints"


def test_a_term_that_is_not_a_number_fails():
    assert first_failures(terms(force_closure=float("nan")), EnergyParameters())[0] == "force_closure"


def test_of_near_grasps_the_best_stays():
    turned = [Rotation.from_rotvec([0, 0, angle]).as_quat(scalar_first=True) for angle in (0, 0.1, 0, 0, 0.4, 0)]
    turned[1] = -turned[1]  # the same rotation
    grasps = Grasps(
        position=np.array([[0, 0, 0.0], [0.004, 0, 0], [0.02, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]]),
        rotation=np.array(turned),
        q=np.zeros((6, 16)),
        contacts=np.zeros((6, 0), dtype=np.int64),
    )
    grasps.q[3, 7] = 0.3
    energies = np.array([2.0, 1.0, 3.0, 3.0, 3.0, 0.5])
    eligible = np.array([True, True, True, True, True, False])
    # 0 is like 1, which is better; 2 stands, 3 bends and 4 turns elsewhere; 5 has been rejected before.
    assert duplicates(grasps, energies, eligible).tolist() == [True, False, False, False, False, False]


def test_every_finger_of_a_set_has_a_contact_and_the_palm_counts_three_times():
    slots = contact_slots(HAND, ("ring", "palm"), 3)
    fingers = np.array(HAND.contact_finger)
    assert set(fingers[slots[0] > 0]) == {"ring"} and set(fingers[slots[1] > 0]) == {"palm"}
    ring_links = {HAND.contact_link[i] for i in np.flatnonzero(fingers == "ring")}
    assert slots[2][fingers == "palm"].sum() == pytest.approx(3 / (3 + len(ring_links)))
    distal = contact_slots(HAND, ("thumb", "index"), 2, ["link_15.0", "link_15.0_tip", "link_3.0", "link_3.0_tip"])
    names = {HAND.link_names[HAND.contact_link[i]] for i in np.flatnonzero(distal[1])}
    assert names == {"link_3.0", "link_3.0_tip"}
    free = contact_slots(HAND, ("ring", "palm"), 4, free=True)
    for slot in free:  # the released code draws every contact from all links, palm 3, each of four links 1
        assert slot[fingers == "palm"].sum() == pytest.approx(3 / 7)
        assert slot[fingers == "ring"].sum() == pytest.approx(4 / 7)
    for slot in (*slots, *distal, *free):
        assert slot.sum() == pytest.approx(1)


@pytest.mark.parametrize(
    ("links", "message"), [(["link_9.0"], "link_9.0"), (["link_3.0"], "leaves the thumb no contact"), (["tip"], "tip")]
)
def test_links_that_cannot_hold_are_refused(links, message):
    with pytest.raises(UserError, match=message):
        contact_slots(HAND, ("thumb", "index"), 2, links)


def test_blocks_hold_every_point_once():
    points = np.random.default_rng(1).normal(size=(1003, 3))
    blocks = block_order(points)
    assert sorted(np.concatenate(blocks).tolist()) == list(range(1003))
    assert max(len(block) for block in blocks) <= 32 and len(blocks) == 32
