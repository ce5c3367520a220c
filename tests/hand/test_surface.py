"""Surface samples of hand, flange and mount."""

import subprocess
import sys

import numpy as np
import pytest

from pipeline.hand.model import load_hand
from pipeline.hand.surface import farthest_points, hand_surface, mount_surface

HAND = load_hand("allegro")
MOUNT = HAND.mount


def test_hand_surface_points_lie_on_a_shape_of_their_link() -> None:
    links, points = hand_surface(1000, HAND)
    assert len(links) == len(points) == 1000
    best = np.full(len(points), np.inf)
    for link, pose, half in zip(HAND.box_link, HAND.box_pose, HAND.box_half, strict=True):
        local = (points - pose[:3, 3]) @ pose[:3, :3]
        own = links == link
        depth = np.abs(np.abs(local) - half)  # distance to each pair of faces
        within = (np.abs(local) <= half + 1e-9).all(1)
        best = np.where(own & within, np.minimum(best, depth.min(1)), best)
    for link, centre, radius in zip(HAND.sphere_link, HAND.sphere_centre, HAND.sphere_radius, strict=True):
        own = links == link
        best = np.where(own, np.minimum(best, np.abs(np.linalg.norm(points - centre, axis=1) - radius)), best)
    assert best.max() < 1e-9


def test_hand_surface_covers_every_link_by_area() -> None:
    links, _ = hand_surface(1000, HAND)
    counts = np.bincount(links, minlength=len(HAND.link_names))
    assert (counts > 0).all()
    assert counts[HAND.link("base_link")] == counts.max()
    ball = 4 * np.pi * 0.012**2
    area = 8 * (HAND.box_half * np.roll(HAND.box_half, 1, axis=1)).sum() + 4 * ball
    assert counts[HAND.link("link_3.0_tip")] == pytest.approx(1000 * ball / area, abs=1)


def test_samples_are_the_same_in_another_process() -> None:
    code = (
        "import sys; from pipeline.hand.model import load_hand; from pipeline.hand.surface import *;"
        "hand = load_hand('allegro'); l, p = hand_surface(300, hand);"
        "sys.stdout.buffer.write(l.tobytes() + p.tobytes() + mount_surface(hand, 50).tobytes())"
    )
    other = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout
    links, points = hand_surface(300, HAND)
    assert other == links.tobytes() + points.tobytes() + mount_surface(HAND, 50).tobytes()


def test_farthest_points_spread() -> None:
    line = np.linspace(0, 1, 101)[:, None]
    assert farthest_points(line, 3).tolist() == [0, 100, 50]


def test_the_mount_has_the_published_net_transform_to_the_last_bit() -> None:
    """Palm normal (+x) = +z of link7, hand +y = -x, fingers (+z) = -y."""
    published = np.array([[0, -1.0, 0, 0], [0, 0, -1, -0.14], [1, 0, 0, 0.132], [0, 0, 0, 1]])
    np.testing.assert_array_equal(MOUNT.T_link7_hand, published)
    assert not np.signbit(MOUNT.T_link7_hand[published == 0]).any()
    np.testing.assert_array_equal(MOUNT.T_link7_mount[:3, :3], np.diag([-1.0, -1, 1]))


def test_mount_surface_lies_behind_the_palm_on_flange_or_mount_box() -> None:
    points = mount_surface(HAND, 200)
    assert len(points) == 200
    in_link7 = points @ MOUNT.T_link7_hand[:3, :3].T + MOUNT.T_link7_hand[:3, 3]
    box, half = MOUNT.T_link7_box, MOUNT.box_half
    local = (in_link7 - box[:3, 3]) @ box[:3, :3]
    on_box = (np.abs(local) <= half + 1e-9).all(1) & (np.abs(np.abs(local) - half).min(1) < 1e-9)
    near_flange = (np.linalg.norm(in_link7[:, :2], axis=1) < 0.1) & (in_link7[:, 2] < 0.12)
    assert (on_box | near_flange).all()
    assert on_box.any() and (~on_box).any()
    # Fingers point along +z of the hand; flange and mount are 6 cm and more behind the wrist.
    assert points[:, 2].max() < -0.06
