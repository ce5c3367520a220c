"""Finger moves: what should move does, by the distance asked for, and nothing else."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.model import load_hand
from pipeline.hand.moves import finger_joints, move_points, squeeze_joints

HAND = load_hand("allegro")
BENT = np.array([0, 0.8, 0.6, 0.4] * 3 + [1.2, 0.4, 0.5, 0.5])


def candidate(finger: str, link: str) -> int:
    own = np.flatnonzero(HAND.contact_link == HAND.link(link))
    assert all(HAND.contact_finger[index] == finger for index in own)
    return int(own[len(own) // 2])


def contacts(q: np.ndarray, candidates: np.ndarray) -> np.ndarray:
    return points_on_links(link_poses(HAND, q[None]), HAND.contact_link[candidates], HAND.contact_points[candidates])[0]


def contact_directions(q: np.ndarray, candidates: np.ndarray) -> np.ndarray:
    T = link_poses(HAND, q[None])[0]
    return np.stack([T[HAND.contact_link[c], :3, :3] @ HAND.contact_normals[c] for c in candidates])


def test_finger_joints_are_sorted_and_the_palm_has_none() -> None:
    assert finger_joints(["thumb", "index"], HAND).tolist() == [0, 1, 2, 3, 12, 13, 14, 15]
    assert finger_joints(["palm"], HAND).tolist() == []


def test_squeeze_moves_contacts_a_centimetre_along_the_normals() -> None:
    candidates = np.array([candidate("thumb", "link_15.0_tip"), candidate("index", "link_3.0_tip")])
    inward = contact_directions(BENT, candidates)  # the object is where the links' own surfaces look
    squeezed = squeeze_joints(HAND, BENT, candidates, inward, 0.01, ["thumb", "index"])
    moved = contacts(squeezed, candidates) - contacts(BENT, candidates)
    np.testing.assert_allclose((moved * inward).sum(1), 0.01, atol=1e-3)
    np.testing.assert_allclose(moved, 0.01 * inward, atol=2e-3)


def test_squeeze_leaves_other_fingers_alone() -> None:
    candidates = np.array([candidate("thumb", "link_15.0_tip"), candidate("index", "link_3.0_tip")])
    inward = contact_directions(BENT, candidates)
    squeezed = squeeze_joints(HAND, BENT, candidates, inward, 0.01, ["thumb", "index"])
    untouched = [*HAND.finger_joints["middle"], *HAND.finger_joints["ring"]]
    np.testing.assert_array_equal(squeezed[untouched], BENT[untouched])
    one_finger = squeeze_joints(HAND, BENT, candidates, inward, 0.01, ["index"])
    np.testing.assert_array_equal(one_finger[4:], BENT[4:])
    assert not np.array_equal(one_finger[:4], BENT[:4])


def test_palm_contacts_do_not_move_the_ring() -> None:
    ring, palm = candidate("ring", "link_11.0_tip"), candidate("palm", "base_link")
    inward = contact_directions(BENT, np.array([ring, palm]))
    both = squeeze_joints(HAND, BENT, np.array([ring, palm]), inward, 0.01, ["ring", "palm"])
    alone = squeeze_joints(HAND, BENT, np.array([ring]), inward[:1], 0.01, ["ring"])
    np.testing.assert_array_equal(both, alone)


@settings(max_examples=30, deadline=None)
@given(
    direction=st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)).filter(lambda v: np.linalg.norm(v) > 0.1),
    length=st.floats(0.0, 0.008),
)
def test_small_reachable_moves_end_where_asked(direction: tuple[float, float, float], length: float) -> None:
    links, points = [HAND.link("link_11.0_tip")], np.array([[0.012, 0.0, 0.0]])
    joints = finger_joints(["ring"], HAND)
    displacement = length * np.array(direction) / np.linalg.norm(direction)
    q = move_points(HAND, BENT, links, points, displacement[None], joints, iterations=60)
    begin, end = (points_on_links(link_poses(HAND, x[None]), np.array(links), points)[0, 0] for x in (BENT, q))
    np.testing.assert_allclose(end - begin, displacement, atol=5e-4)


def test_limits_are_kept_when_the_target_is_out_of_reach() -> None:
    links, points = [HAND.link("link_3.0_tip")], np.zeros((1, 3))
    q = move_points(HAND, BENT, links, points, np.array([[0.0, 0.0, 1.0]]), finger_joints(["index"], HAND))
    assert (q >= HAND.lower).all() and (q <= HAND.upper).all()
