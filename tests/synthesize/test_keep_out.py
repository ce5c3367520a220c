"""Places that a grasp leaves free: where they are, and that grasps leave them."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.energy.keep_out import PINCHED_RADIUS, fingers_used, keep_out_points
from pipeline.energy.scene import EnergyScene, Grasps
from pipeline.hand.kinematics import link_poses
from pipeline.hand.model import load_hand
from pipeline.records.parameters.synthesize import EnergyParameters
from tests.synthesize import shapes
from tests.synthesize.test_energy import SIDE

HAND = load_hand("allegro")


def tips_and_corners(finger: str, names: list[str], seed: int) -> np.ndarray:
    """Tip centres and box corners (n, 3), hand frame, of a finger in random postures between those listed."""
    rng = np.random.default_rng(seed)
    first, bent = HAND.holding[finger].first, np.array(HAND.holding[finger].bent)
    q = np.zeros((20, 16))
    q[:, HAND.finger_joints[finger][0]] = rng.uniform(min(first), max(first), 20)
    share = rng.random((20, 1))
    q[:, list(HAND.finger_joints[finger][1:])] = bent[0] + share * (bent[2] - bent[0])
    T = link_poses(HAND, q)
    signs = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), -1).reshape(-1, 3)
    found = []
    for link, pose, half in zip(HAND.box_link, HAND.box_pose, HAND.box_half, strict=True):
        if HAND.link_names[link] in names:
            corners = np.c_[signs * half, np.ones(8)] @ (T[:, link] @ pose).transpose(0, 2, 1)
            found.append(corners[..., :3].reshape(-1, 3))
    return np.concatenate(found)


@pytest.mark.parametrize(
    ("style", "finger", "names", "spacing"),
    [
        (("palm", "ring"), "thumb", ["link_12.0"], 0.008),
        (("palm", "ring"), "thumb", list(HAND.finger_links["thumb"]), 0.02),
        (("palm", "ring"), "middle", list(HAND.finger_links["middle"]), 0.025),
        (("index", "middle", "thumb"), "ring", list(HAND.finger_links["ring"]), 0.025),
    ],
)
def test_points_lie_about_the_other_fingers_wherever_they_hold(style, finger, names, spacing):
    points = keep_out_points(style, HAND)
    corners = tips_and_corners(finger, names, seed=3)
    nearest = np.linalg.norm(corners[:, None] - points, axis=-1).min(1)
    assert nearest.max() < spacing


def test_the_pinched_ball_lies_in_front_of_the_palm_on_the_thumb_and_index_side():
    ball = keep_out_points(("palm", "ring"), HAND)[-60:]
    centre = (ball.min(0) + ball.max(0)) / 2
    np.testing.assert_allclose(np.linalg.norm(ball - centre, axis=1), PINCHED_RADIUS, atol=0.004)
    assert 0.08 < centre[0] < 0.13 and 0.0 < centre[1] < 0.05 and abs(centre[2]) < 0.04


def test_a_style_leaves_free_only_what_it_does_not_use():
    assert fingers_used([["thumb", "index"], ["thumb", "middle"]]) == ("index", "middle", "thumb")
    assert len(keep_out_points(("index", "middle", "ring", "thumb"), HAND)) == 0
    pinch = keep_out_points(("index", "middle", "thumb"), HAND)
    ring_base = link_poses(HAND, np.zeros((1, 16)))[0, HAND.link("link_9.0"), :3, 3]
    assert np.linalg.norm(pinch - ring_base, axis=1).max() < 0.17  # no farther than a ring finger is long


def test_an_object_on_the_thumbs_base_is_pushed_off_it():
    scene = EnergyScene(shapes.cylinder(), EnergyParameters(), SIDE, HAND)
    plainly = SIDE.model_copy(update={"keep_out_margin": None})
    without = EnergyScene(shapes.cylinder(), EnergyParameters(), plainly, HAND)
    q = np.zeros((1, 16))
    base = keep_out_points(("palm", "ring"), HAND)[450:690].mean(0)
    # Hand axes are object axes, the object's middle beside the thumb's base, on the palm's side of it (+x).
    grasp = Grasps(-(base + [0.03, 0.0, 0.0])[None], np.array([[1.0, 0, 0, 0]]), q, np.array([[0, 60, 61]]))
    terms, gradient = scene.evaluate(grasp)
    plain, plain_gradient = without.evaluate(grasp)
    assert terms.keep_out[0] > 0 and plain.keep_out[0] == 0
    assert terms.energy[0] - plain.energy[0] == pytest.approx(100 * terms.keep_out[0], rel=1e-4)
    assert (gradient - plain_gradient)[0, 0] > 0  # downhill, the hand goes to -x: away from the object
