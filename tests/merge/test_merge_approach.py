"""Approaches of a merged grasp, checked again by brute force."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.moves import finger_joints
from pipeline.hand.surface import hand_surface, mount_surface
from pipeline.pairing.approach import first_opening, later_approach, motion_clearance
from pipeline.records.poses import transform_points
from tests.merge.constructed import HAND, RING_JOINTS, box, cylinder, joined

LENGTHS = [0.2, 0.12, 0.07]
OBJECTS = [box(), cylinder()]


def in_cylinder(points: np.ndarray) -> np.ndarray:
    """Depth in the cylinder of the fixtures, m, from its formula; negative outside."""
    return np.minimum(0.0285 - np.linalg.norm(points[..., :2], axis=-1), 0.0525 - np.abs(points[..., 2]))


def test_second_approach_sweeps_through_nothing() -> None:
    grasp = joined()
    approach = later_approach(grasp, 1, OBJECTS, 0.03, LENGTHS, 0.001)
    assert approach.penetrations == 0
    assert approach.length == 0.2
    assert np.linalg.norm(approach.direction) == pytest.approx(1.0)
    links, samples = hand_surface(3000, HAND)
    in_hand = points_on_links(link_poses(HAND, approach.open_q[None]), links, samples)[0]
    held = transform_points(grasp.T_hand_object[0], box().surface_points)
    points = transform_points(grasp.singles[1].T_object_hand, np.concatenate([in_hand, mount_surface(HAND, 500), held]))
    for offset in np.arange(0.0, approach.length, 0.002):
        moved = points + offset * approach.direction
        assert in_cylinder(moved).max() < 0.002  # other sample points than the selector's, twice its tolerance
        assert moved[:, 2].min() > cylinder().bottom - 0.002


def test_second_approach_opens_only_the_ring() -> None:
    grasp = joined()
    approach = later_approach(grasp, 1, OBJECTS, 0.03, LENGTHS, 0.001)
    pinching = finger_joints(["thumb", "index", "middle"], HAND)
    np.testing.assert_array_equal(approach.open_q[pinching], grasp.squeeze_q[pinching])
    assert not np.allclose(approach.open_q[RING_JOINTS], grasp.q[RING_JOINTS])


def test_second_approach_sees_the_held_object() -> None:
    clear = joined()
    # Object 0 hangs in front of the palm, on the side of the hand from which object 1 must come.
    T = clear.T_hand_object[1].copy()
    T[0, 3] += 0.0285 + 0.021 + 0.003
    blocked = replace(clear, T_hand_held=(T, clear.T_hand_held[1]))
    assert later_approach(blocked, 1, OBJECTS, 0.03, LENGTHS, 0.001).penetrations > 0


def test_first_opening_takes_the_ring_out_of_the_way() -> None:
    grasp = joined()
    open_q, clearance = first_opening(HAND, grasp.singles[0], box(), ["ring"])
    assert clearance > 0
    pinching = np.setdiff1d(np.arange(16), RING_JOINTS)
    np.testing.assert_array_equal(open_q[pinching], grasp.singles[0].open_q[pinching])
    links, samples = hand_surface(3000, HAND)
    points = points_on_links(link_poses(HAND, open_q[None]), links, samples)[0]
    ring = np.isin(links, [HAND.link(f"link_{index}.0") for index in (8, 9, 10, 11)])
    heights = transform_points(grasp.singles[0].T_object_hand, points[ring])[:, 2]
    assert heights.min() > box().bottom


def test_ring_that_would_close_through_object_0_is_seen() -> None:
    grasp = joined()
    open_q = grasp.q.copy()
    open_q[RING_JOINTS] = 0.0
    assert motion_clearance(grasp, 1, open_q, OBJECTS) > -0.001
    q = grasp.q.copy()
    q[RING_JOINTS] *= 0.6  # somewhere on the way
    tip = link_poses(HAND, q[None])[0, HAND.link("link_11.0_tip"), :3, 3]
    T = np.eye(4)
    T[:3, 3] = tip
    assert motion_clearance(replace(grasp, T_hand_held=(T, grasp.T_hand_held[1])), 1, open_q, OBJECTS) < -0.005
