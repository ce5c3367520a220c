"""Exact scores, the filter, and duplicates, against values known from geometry."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.hand.allegro import load_hand
from pipeline.records.parameters.synthesize import EnergyParameters
from pipeline.synthesize.energy import Grasps, Terms, contact_shares, contact_slots
from pipeline.synthesize.scoring import ExactSurface, duplicates, first_failures, force_closure
from tests.synthesize import shapes


def terms(**values: float) -> Terms:
    names = ("energy", "force_closure", "distance", "penetration", "table", "self_penetration", "joints")
    return Terms(*(np.array([values.get(name, 0.0)]) for name in names))


def test_distance_and_normal_of_a_box():
    points = np.array([[0.03, 0, 0], [0.02, 0.001, 0.002], [0.024, 0.025, 0], [0.0, 0, -0.021]])
    distance, normal = ExactSurface(shapes.box()).distance_and_normal(points)
    np.testing.assert_allclose(distance, [0.009, -0.001, 0.005, 0], atol=1e-6)
    np.testing.assert_allclose(normal, [[1, 0, 0], [1, 0, 0], [0.6, 0.8, 0], [0, 0, -1]], atol=1e-3)


def test_opposed_contacts_close_and_offset_contacts_do_not():
    points = np.array([[[0.021, 0, 0], [-0.021, 0, 0]], [[0.021, 0.01, 0], [-0.021, -0.01, 0]]])
    normals = np.array([[[1.0, 0, 0], [-1, 0, 0]]] * 2)
    shares = np.ones((2, 2))
    scale = 1 / 0.021
    # Two unit forces 2 cm apart make a torque of 0.02 m.
    np.testing.assert_allclose(force_closure(points, normals, shares, scale), [0, (0.02 * scale) ** 2], atol=1e-12)
    np.testing.assert_allclose(force_closure(points, normals, shares, 1.0), [0, 0.02**2], atol=1e-12)


def test_three_fingers_balance_against_the_thumb():
    hand = load_hand()
    contacts = np.array([[hand.contact_finger.index(finger) for finger in ("thumb", "index", "middle")]])
    shares = contact_shares(hand, contacts, balance=True)
    np.testing.assert_allclose(shares, [[1.5, 0.75, 0.75]])
    normals = np.array([[[1.0, 0, 0], [-1, 0, 0], [-1, 0, 0]]])
    points = np.array([[[0.02, 0, 0], [-0.02, 0.01, 0], [-0.02, -0.01, 0]]])
    assert force_closure(points, normals, shares, 50.0)[0] == pytest.approx(0, abs=1e-12)
    assert force_closure(points, normals, contact_shares(hand, contacts, False), 50.0)[0] == pytest.approx(1.0)


def test_every_finger_has_a_contact_and_the_palm_three_shares():
    hand = load_hand()
    ring, palm, either = contact_slots(hand, ["ring", "palm"], 3, 4)
    finger = np.array(hand.contact_finger)
    assert set(finger[ring > 0]) == {"ring"} and set(finger[palm > 0]) == {"palm"}
    assert either[finger == "palm"].sum() == pytest.approx(3 / 7)  # four ring links and the palm three times
    (thumb, index) = contact_slots(hand, ["thumb", "index"], 2, 2)
    names = np.array(hand.link_names)[hand.contact_link]
    assert set(names[thumb > 0]) == {"link_15.0", "link_15.0_tip"}
    assert set(names[index > 0]) == {"link_3.0", "link_3.0_tip"}


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({}, ""),
        ({"joints": 0.01, "distance": 1.0}, "joints"),
        ({"distance": 0.006, "table": 1.0}, "distance"),
        ({"force_closure": 0.4}, "force_closure"),
        ({"penetration": 0.0011}, "penetration"),
        ({"penetration": 0.0006, "table": 0.0006}, "table"),
        ({"self_penetration": 0.002}, "self_penetration"),
    ],
)
def test_first_failure_is_named(values, reason):
    assert first_failures(terms(**values), EnergyParameters())[0] == reason


def test_a_term_that_is_not_a_number_fails():
    assert first_failures(terms(force_closure=float("nan")), EnergyParameters())[0] == "force_closure"


def test_a_duplicate_of_a_better_grasp_is_found():
    # 0 and 1 are alike, 2 is turned by 20 degrees, 3 has another joint, 4 would be a duplicate but is not eligible.
    turn = np.array([np.cos(np.deg2rad(10)), np.sin(np.deg2rad(10)), 0, 0])
    rotation = np.tile([1.0, 0, 0, 0], (5, 1))
    rotation[1] *= -1  # the same rotation
    rotation[2] = turn
    q = np.zeros((5, 16))
    q[1, 4], q[3, 4] = 0.1, 0.5
    position = np.zeros((5, 3))
    position[1, 0] = 0.005
    grasps = Grasps(position, rotation, q, np.zeros((5, 0), dtype=np.int64))
    eligible = np.array([True, True, True, True, False])
    energies = np.array([0.5, 0.4, 0.3, 0.2, 0.1])
    assert duplicates(grasps, energies, eligible).tolist() == [True, False, False, False, False]
