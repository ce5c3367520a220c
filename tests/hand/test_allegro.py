"""The hand's description against the published tables and against other readers of the URDF."""

import xml.etree.ElementTree as ElementTree
from collections import Counter

import numpy as np
import pytest

from pipeline.hand.model import load_hand

HAND = load_hand("allegro")
TIP_RADIUS = 0.012  # m
FINGER_LIMITS = ([-0.47, -0.196, -0.174, -0.227], [0.47, 1.61, 1.709, 1.618])
THUMB_LIMITS = ([0.263, -0.105, -0.189, -0.162], [1.396, 1.163, 1.644, 1.719])


def test_joint_limits_are_the_published_ones() -> None:
    np.testing.assert_allclose(HAND.lower, FINGER_LIMITS[0] * 3 + THUMB_LIMITS[0])
    np.testing.assert_allclose(HAND.upper, FINGER_LIMITS[1] * 3 + THUMB_LIMITS[1])


def test_links_are_the_twenty_one_with_collision_shapes() -> None:
    numbered = {f"link_{index}.0" for index in range(16)} | {f"link_{index}.0_tip" for index in (3, 7, 11, 15)}
    assert set(HAND.link_names) == {"base_link"} | numbered
    assert len(HAND.link_names) == 21
    assert all(parent < link for link, parent in enumerate(HAND.parent))


def test_fingers_partition_joints_and_links() -> None:
    assert sorted(joint for joints in HAND.finger_joints.values() for joint in joints) == list(range(16))
    links = [link for own in HAND.finger_links.values() for link in own]
    assert len(links) == len(set(links)) == 17
    unowned = set(HAND.link_names) - set(links)
    assert unowned == {"link_0.0", "link_4.0", "link_8.0", "link_12.0"}


def test_contact_candidates_per_link_and_finger() -> None:
    per_link = Counter(HAND.link_names[link] for link in HAND.contact_link)
    expected = {"base_link": 12, "link_14.0": 8, "link_15.0": 6}
    for proximal in (1, 5, 9):
        expected |= {f"link_{proximal}.0": 8, f"link_{proximal + 1}.0": 6, f"link_{proximal + 2}.0": 5}
    expected |= {f"link_{tip}.0_tip": 15 for tip in (3, 7, 11, 15)}
    assert per_link == expected
    assert len(HAND.contact_points) == 143
    assert Counter(HAND.contact_finger) == {"index": 34, "middle": 34, "ring": 34, "thumb": 29, "palm": 12}


def test_tip_candidates_face_the_palm_side() -> None:
    tips = np.isin(HAND.contact_link, HAND.sphere_link)
    points = HAND.contact_points[tips]
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), TIP_RADIUS)
    assert (points[:, 0] > 0).all() and (points[:, 2] > 0).all()
    azimuth = np.degrees(np.arctan2(points[:, 1], points[:, 0]))
    assert np.abs(azimuth).max() == pytest.approx(54.0)
    polar = np.degrees(np.arccos(points[:, 2] / TIP_RADIUS))
    assert (polar.min(), polar.max()) == pytest.approx((27.0, 81.0))


def test_fingertip_ball_is_the_front_of_the_simulated_tip() -> None:
    """The simulated tip is a dome of 12 mm on a cylinder of 12 mm; candidates lie on the dome (z > 0)."""
    trimesh = pytest.importorskip("trimesh")
    root = ElementTree.parse(HAND.urdf).getroot()
    mesh = root.find("link[@name='link_3.0_tip']/collision/geometry/mesh")
    assert mesh is not None
    tip = trimesh.load_mesh(HAND.urdf.parent / mesh.get("filename", ""))
    dome = tip.vertices[tip.vertices[:, 2] >= 0]
    np.testing.assert_allclose(np.linalg.norm(dome, axis=1), TIP_RADIUS, atol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(tip.vertices[:, :2], axis=1).max(), TIP_RADIUS, atol=1e-4)
    np.testing.assert_allclose(tip.bounds[:, 2], [-0.011, 0.012], atol=1e-4)


def test_joint_names_are_in_finger_order() -> None:
    assert tuple(f"joint_{index}.0" for index in range(16)) == HAND.joint_names
    for finger in ("index", "middle", "ring", "thumb"):
        for joint, link in zip(HAND.finger_joints[finger][1:], HAND.finger_links[finger], strict=False):
            assert HAND.joint[HAND.link(link)] == joint
