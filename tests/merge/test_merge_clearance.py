"""Static distances against geometry worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.hand.kinematics import link_poses
from pipeline.pairing.clearance import (
    distance_to_links,
    finger_clearance,
    hand_clearance,
    held_object_height,
    holding_links,
    links_of,
    mount_height,
    object_clearance,
    posed_hand,
    self_clearance,
    support_height,
)
from pipeline.records.poses import inverse_pose, transform_points
from tests.merge.constructed import HAND, PALM_FACE, RING_JOINTS, TIP_RADIUS, box, cylinder, joined, pinch, side


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


def merged(**changes):
    """The constructed grasp; ``held0``, ``held1`` replace the pose of an object in the hand."""
    grasp = joined()
    held = tuple(changes.pop(f"held{index}", T) for index, T in enumerate(grasp.T_hand_held))
    return replace(grasp, T_hand_held=held, **changes)


@pytest.mark.parametrize("gap", [0.013, 0.002, -0.004])
def test_object_clearance_of_two_boxes_is_their_gap(gap: float) -> None:
    side_length = float(box().extents[0])
    grasp = merged(held0=at(), held1=at(x=side_length + gap))
    assert object_clearance(grasp, [box(), box()]) == pytest.approx(gap, abs=2e-4)


def test_distance_to_links_is_exact_for_boxes_and_balls() -> None:
    posed = posed_hand(HAND, pinch().q)
    tip = HAND.link("link_3.0_tip")
    centre = posed.T_hand_link[tip][:3, 3]
    directions = np.random.default_rng(0).normal(size=(20, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = centre + np.array([0.004, 0.02] * 10)[:, None] * directions
    distances = [distance_to_links(posed, np.array([tip]), point[None]) for point in points]
    np.testing.assert_allclose(distances, [0.004 - TIP_RADIUS, 0.02 - TIP_RADIUS] * 10, atol=1e-12)
    # In front of the palm, over the upper of its boxes: the distance is that along the palm normal.
    front = np.array([[PALM_FACE + 0.007, 0.0, -0.02], [PALM_FACE - 0.003, 0.0, -0.02]])
    distances = [distance_to_links(posed, np.array([0]), point[None]) for point in front]
    np.testing.assert_allclose(distances, [0.007, -0.003], atol=1e-12)
    assert distance_to_links(posed, np.array([0]), front) == pytest.approx(-0.003)
    assert distance_to_links(posed, np.array([0]), front[:1], below=0.002) == 0.002


def test_distance_to_links_leaves_nothing_near_out() -> None:
    """Against the plain formula for every box and ball, over clouds of points at all distances."""
    generator = np.random.default_rng(1)
    links = np.array([HAND.link(name) for name in ("base_link", "link_12.0", "link_10.0", "link_11.0_tip")])
    for _ in range(20):
        q = generator.uniform(HAND.lower, HAND.upper)
        posed = posed_hand(HAND, q)
        T = posed.T_hand_link
        points = generator.uniform(-0.15, 0.15, 3) + generator.uniform(-0.03, 0.03, (200, 3))
        expected = 1.0
        for link, pose, half in zip(HAND.box_link, HAND.box_pose, HAND.box_half, strict=True):
            if link in links:
                inside = transform_points(inverse_pose(T[link] @ pose), points)
                nearest = np.clip(inside, -half, half)
                depth = np.where((nearest == inside).all(1), (half - np.abs(inside)).min(1), 0.0)
                expected = min(expected, float((np.linalg.norm(inside - nearest, axis=1) - depth).min()))
        for link, centre, radius in zip(HAND.sphere_link, HAND.sphere_centre, HAND.sphere_radius, strict=True):
            if link in links:
                middle = transform_points(T[link], centre[None])
                expected = min(expected, float(np.linalg.norm(points - middle, axis=1).min() - radius))
        assert distance_to_links(posed, links, points) == pytest.approx(expected, abs=1e-12)


def test_holding_links_do_not_include_finger_bases() -> None:
    names = {HAND.link_names[link] for link in holding_links(HAND, ("ring", "palm"))}
    assert names == {"base_link", "link_9.0", "link_10.0", "link_11.0", "link_11.0_tip"}


def test_constructed_merge_is_clear() -> None:
    grasp = merged()
    assert object_clearance(grasp, [box(), cylinder()]) > 0.01
    assert hand_clearance(grasp, posed_hand(HAND, grasp.q), [box(), cylinder()]) > 0
    assert self_clearance(grasp, posed_hand(HAND, grasp.q)) > 0.01


def test_object_1_in_the_thumb_base_is_seen() -> None:
    thumb_base = HAND.link("link_12.0")
    box_of_base = int(np.flatnonzero(HAND.box_link == thumb_base)[0])
    centre = link_poses(HAND, pinch().q[None])[0, thumb_base] @ HAND.box_pose[box_of_base]
    grasp = merged(held1=at(*centre[:3, 3]))
    # A box of 42 mm around the centre of a link of 35.8 x 34 x 45.5 mm: the surface of each lies in the other.
    assert hand_clearance(grasp, posed_hand(HAND, grasp.held_q), [box(), box()]) < -0.005


def test_object_0_in_the_ring_finger_is_seen() -> None:
    tip = link_poses(HAND, side().q[None])[0, HAND.link("link_11.0_tip"), :3, 3]
    grasp = merged(held0=at(*tip))
    assert hand_clearance(grasp, posed_hand(HAND, grasp.held_q), [box(), cylinder()]) < -0.01


def test_crossed_ring_and_middle_fingers_are_seen() -> None:
    q = np.zeros(16)
    q[12] = HAND.lower[12]
    q[[5, 9]] = 1.2  # bent forward, so that the first joint moves the finger sideways
    assert finger_clearance(posed_hand(HAND, q), ["ring"]) > 0.005
    q[[4, 8]] = -0.47, 0.47  # towards each other
    assert finger_clearance(posed_hand(HAND, q), ["ring"]) < -0.001


def test_heights_follow_the_hand_and_the_plane() -> None:
    low = mount_height(HAND, side().T_object_hand, cylinder())
    T = side().T_object_hand.copy()
    T[2, 3] += 0.05
    assert mount_height(HAND, T, cylinder()) == pytest.approx(low + 0.05)
    # Hand y is up: the mount's box is 34 mm thick there at most, its lowest corner is found from its own description.
    flange_axis = transform_points(inverse_pose(HAND.mount.T_link7_hand), np.array([[0.0, 0.0, 0.107]]))[0]
    over_plane = transform_points(side().T_object_hand, flange_axis[None])[0, 2] - cylinder().bottom
    assert 0.02 < over_plane - low < 0.10  # the flange reaches 2 to 10 cm below its own axis


def test_support_height_is_that_of_the_lowest_link() -> None:
    q = np.zeros(16)
    # Fingers up: the lowest part of the hand alone is the thumb or the palm's lower edge.
    palm_only = support_height(posed_hand(HAND, q), np.eye(4), 0.0, links_of(HAND, ["base_link"]))
    assert palm_only == pytest.approx(-0.08874 - 0.0065, abs=2e-3)  # lowest palm box, centre and half height
    # Palm up, 30 cm over the plane z = 0.1.
    T = np.eye(4)
    T[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    T[2, 3] = 0.3
    assert support_height(posed_hand(HAND, q), T, 0.1, links_of(HAND, ["base_link"])) == pytest.approx(
        0.2 - PALM_FACE, abs=1e-3
    )


def test_held_object_height_is_measured_over_the_second_objects_plane() -> None:
    grasp = merged(held0=merged().T_hand_object[1])  # object 0 where object 1 is
    assert held_object_height(grasp, 1, [cylinder(), cylinder()]) == pytest.approx(0.0, abs=1e-9)


def test_moving_the_ring_changes_only_what_it_should() -> None:
    grasp = merged()
    q = grasp.q.copy()
    q[RING_JOINTS] = 0.0
    assert object_clearance(replace(grasp, q=q), [box(), cylinder()]) == object_clearance(grasp, [box(), cylinder()])
