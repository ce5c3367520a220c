"""First states: which way the hand looks, and that it starts in free space."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pipeline.energy.contacts import contact_slots
from pipeline.energy.scene import EnergyScene, Grasps
from pipeline.hand.kinematics import link_poses
from pipeline.hand.model import load_hand
from pipeline.hand.moves import finger_joints
from pipeline.hand.surface import hand_surface
from pipeline.records.parameters.synthesize import EnergyParameters, StyleParameters
from pipeline.synthesize.scoring import ExactSurface
from pipeline.synthesize.seeds import (
    draw_seed,
    draw_seeds,
    free_joints,
    join,
    minimal_rotation,
    perturbed_columns,
)
from tests.synthesize import shapes
from tests.synthesize.test_energy import PINCH, SIDE

HAND = load_hand("allegro")
SIDE_POSTURE = np.array(HAND.style("side").posture)
SLOTS = {
    "pinch": contact_slots(HAND, ("thumb", "index"), 2),
    "side": contact_slots(HAND, ("ring", "palm"), 3),
}
SETTINGS = {"pinch": PINCH, "side": SIDE}
OBJECTS = {"pinch": shapes.box(), "side": shapes.cylinder()}


def seeds_of(style: str, count: int, settings: StyleParameters | None = None) -> Grasps:
    settings = settings or SETTINGS[style]
    scene = EnergyScene(OBJECTS[style], EnergyParameters(), settings, HAND)
    generators = [np.random.default_rng([7, index]) for index in range(count)]
    return draw_seeds(scene, HAND, style, settings, SLOTS[style], generators)


def axes(grasps: Grasps) -> np.ndarray:
    return Rotation.from_quat(grasps.rotation, scalar_first=True).as_matrix()


@pytest.mark.parametrize(
    ("style", "palm", "fingers"), [("pinch", [0, 0, -1], [1, 0, 0]), ("side", [0, 1, 0], [1, 0, 0])]
)
def test_hands_face_the_object_from_the_side_of_their_style(style, palm, fingers):
    rng = np.random.default_rng(0)
    drawn = join([draw_seed(HAND, style, SETTINGS[style], SLOTS[style], rng) for _ in range(200)])
    free = seeds_of(style, 48)
    for grasps in (drawn, free):
        R, distance = axes(grasps), np.linalg.norm(grasps.position, axis=1)
        np.testing.assert_allclose(R[:, :, 0], -grasps.position / distance[:, None], atol=1e-9)
        assert distance.min() >= 0.05 and distance.max() <= 0.25
    for axis, mean in ((0, palm), (2, fingers)):
        average = axes(drawn)[:, :, axis].mean(0)
        assert average @ mean / np.linalg.norm(average) > 0.98
        # The table lets hands through that lean over the object; they still look the same way.
        assert (axes(free)[:, :, axis] @ mean).min() > 0


@pytest.mark.parametrize("style", ["pinch", "side"])
def test_no_seed_is_in_the_object_or_under_the_table(style):
    grasps, prepared = seeds_of(style, 48), OBJECTS[style]
    owner, points = hand_surface(1000, HAND)
    T = link_poses(HAND, grasps.q)[:, owner]
    in_hand = np.einsum("bnij,nj->bni", T[..., :3, :3], points) + T[..., :3, 3]
    placed = np.einsum("bij,bnj->bni", axes(grasps), in_hand) + grasps.position[:, None]
    assert placed[..., 2].min() >= prepared.bottom + SETTINGS[style].table_clearance - 1e-6
    distance, _ = ExactSurface(prepared).distance_and_normal(placed.reshape(-1, 3))
    assert distance.min() > 0


def test_heading_spread_turns_hands_about_z():
    def headings(spread: float) -> np.ndarray:
        R = axes(seeds_of("side", 48, SIDE.model_copy(update={"heading_spread": spread})))
        return np.arctan2(R[:, 1, 2], R[:, 0, 2])

    assert np.abs(headings(0.0)).max() < 1.2
    quadrants = np.floor(headings(np.pi) / (np.pi / 2))
    assert set(quadrants) == {-2.0, -1.0, 0.0, 1.0}


def test_side_hands_begin_with_the_other_fingers_in_a_pinch():
    grasps = seeds_of("side", 48)
    held = finger_joints(("thumb", "index", "middle"), HAND)
    assert np.abs(grasps.q[:, held] - SIDE_POSTURE[held]).max() < 0.5
    np.testing.assert_allclose(grasps.q[:, held].mean(0), SIDE_POSTURE[held], atol=0.1)
    assert (grasps.q >= HAND.lower).all() and (grasps.q <= HAND.upper).all()
    np.testing.assert_array_equal(np.flatnonzero(free_joints(HAND, "side", SIDE)), finger_joints(("ring",), HAND))
    np.testing.assert_array_equal(np.flatnonzero(~free_joints(HAND, "pinch", PINCH)), finger_joints(("ring",), HAND))


def test_contacts_are_distinct_and_of_their_slot():
    rng = np.random.default_rng(0)
    for _ in range(50):
        contacts = draw_seed(HAND, "side", SIDE, SLOTS["side"], rng).contacts[0]
        assert len(set(contacts)) == 3
        assert all(slot[contact] > 0 for slot, contact in zip(SLOTS["side"], contacts, strict=True))


@pytest.mark.parametrize("style", ["pinch", "side"])
def test_released_seeds_are_the_first_draw_with_all_joints_free(style):
    released = SETTINGS[style].model_copy(update={"released_seeds": True})
    grasps = seeds_of(style, 300, released)
    assert free_joints(HAND, style, released).all()
    # Means of the truncated normal distributions stay near the posture, but where it lies at a limit.
    posture, width = np.array(HAND.style(style).released_posture), HAND.upper - HAND.lower
    inner = (posture > HAND.lower + 0.3 * width) & (posture < HAND.upper - 0.3 * width)
    assert inner.sum() >= 4
    np.testing.assert_allclose(grasps.q.mean(0)[inner], posture[inner], atol=0.03 * width.max())
    assert (np.abs(grasps.q - posture) <= 0.5 * width).all()
    # Notes of the released code: a third of the pinch draws and four of five side draws begin under the table.
    bare = released.model_copy(update={"mount_clearance": None})
    scene = EnergyScene(OBJECTS[style], EnergyParameters(), bare, HAND)
    below = (scene.evaluate(grasps)[0].table > 0).mean()
    assert (0.2 < below < 0.5) if style == "pinch" else (below > 0.6)


def test_perturbed_columns_keep_bisectors_and_are_a_rotation():
    R = Rotation.random(rng=np.random.default_rng(5)).as_matrix()
    turned = perturbed_columns(R, np.random.default_rng(3))
    np.testing.assert_allclose(turned.T @ turned, np.eye(3), atol=1e-12)
    assert np.linalg.det(turned) == pytest.approx(1)
    noisy = R[:, :2] + 0.1 * np.random.default_rng(3).normal(size=(3, 2))
    a, b = (noisy / np.linalg.norm(noisy, axis=0)).T
    for sign in (1, -1):  # what is symmetric in both columns is left alone
        bisector = (a + sign * b) / np.linalg.norm(a + sign * b)
        assert (turned[:, 0] + sign * turned[:, 1]) @ bisector == pytest.approx(np.sqrt(2))


unit = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array).filter(lambda v: np.linalg.norm(v) > 0.1)


@given(unit, unit)
def test_minimal_rotation_takes_one_vector_to_the_other_by_the_angle_between(start, end):
    start, end = start / np.linalg.norm(start), end / np.linalg.norm(end)
    angle = np.arccos(np.clip(start @ end, -1, 1))
    if angle > np.pi - 1e-3:
        return  # the axis is not determined
    R = minimal_rotation(start, end)
    np.testing.assert_allclose(R @ start, end, atol=1e-9)
    assert Rotation.from_matrix(R).magnitude() == pytest.approx(angle, abs=1e-7)
