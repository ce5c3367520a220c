"""Surface samples of hand, flange and mount."""

import subprocess
import sys

import numpy as np
import pytest

from pipeline.hand.allegro import load_hand
from pipeline.hand.surface import (
    MOUNT_BOX_HALF,
    T_LINK7_HAND,
    T_LINK7_MOUNT,
    farthest_points,
    hand_surface,
    mount_box_pose,
    mount_surface,
)

HAND = load_hand()


def test_hand_surface_points_lie_on_a_shape_of_their_link() -> None:
    links, points = hand_surface(1000)
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
    links, _ = hand_surface(1000)
    counts = np.bincount(links, minlength=len(HAND.link_names))
    assert (counts > 0).all()
    assert counts[HAND.link("base_link")] == counts.max()
    ball = 4 * np.pi * 0.012**2
    area = 8 * (HAND.box_half * np.roll(HAND.box_half, 1, axis=1)).sum() + 4 * ball
    assert counts[HAND.link("link_3.0_tip")] == pytest.approx(1000 * ball / area, abs=1)


def test_samples_are_the_same_in_another_process() -> None:
    code = (
        "import sys; from pipeline.hand.surface import hand_surface, mount_surface; l, p = hand_surface(300);"
        "sys.stdout.buffer.write(l.tobytes() + p.tobytes() + mount_surface(50).tobytes())"
    )
    other = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout
    links, points = hand_surface(300)
    assert other == links.tobytes() + points.tobytes() + mount_surface(50).tobytes()


def test_farthest_points_spread() -> None:
    line = np.linspace(0, 1, 101)[:, None]
    assert farthest_points(line, 3).tolist() == [0, 100, 50]


def test_mount_transforms_multiply_to_the_published_net_transform() -> None:
    # Mount to base_link: xyz (0, 0.12, 0.025), rpy (0, -pi/2, -pi/2).
    T_mount_hand = np.array([[0, 1.0, 0, 0], [0, 0, 1, 0.12], [1, 0, 0, 0.025], [0, 0, 0, 1]])
    np.testing.assert_allclose(T_LINK7_MOUNT @ T_mount_hand, T_LINK7_HAND, atol=1e-12)
    np.testing.assert_allclose(T_LINK7_HAND[:3, 3], [0, -0.14, 0.132])


def test_mount_surface_lies_behind_the_palm_on_flange_or_mount_box() -> None:
    points = mount_surface(200)
    assert len(points) == 200
    in_link7 = points @ T_LINK7_HAND[:3, :3].T + T_LINK7_HAND[:3, 3]
    box = mount_box_pose()
    local = (in_link7 - box[:3, 3]) @ box[:3, :3]
    on_box = (np.abs(local) <= MOUNT_BOX_HALF + 1e-9).all(1) & (np.abs(np.abs(local) - MOUNT_BOX_HALF).min(1) < 1e-9)
    near_flange = (np.linalg.norm(in_link7[:, :2], axis=1) < 0.1) & (in_link7[:, 2] < 0.12)
    assert (on_box | near_flange).all()
    assert on_box.any() and (~on_box).any()
    # Fingers point along +z of the hand; flange and mount are 6 cm and more behind the wrist.
    assert points[:, 2].max() < -0.06
