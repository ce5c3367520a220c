import numpy as np

from pipeline.hand.approach import HandAtObject, approach_directions, choose_approach, open_postures
from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.model import load_hand
from tests.physics.shapes import prepared_box

HAND = load_hand("allegro")
REST = np.clip(np.array([0, 0.7, 0.6, 0.6] * 3 + [1.0, 0.5, 0.7, 0.8]), HAND.lower, HAND.upper)


def tip_candidates(finger: str) -> np.ndarray:
    tip = {"index": "link_3.0_tip", "ring": "link_11.0_tip", "thumb": "link_15.0_tip"}[finger]
    return np.nonzero(HAND.contact_link == HAND.link(tip))[0][7:8]


def facing_down(height: float) -> np.ndarray:
    """Fingers (+z of the hand) down, palm normal (+x) along +x of the object, base_link `height` over the origin."""
    T = np.eye(4)
    T[:3, :3] = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
    T[:3, 3] = -0.05, 0.0, height
    return T


def test_opening_moves_contacts_horizontally_away_from_the_axis() -> None:
    T = facing_down(0.15)
    contacts = np.concatenate([tip_candidates("index"), tip_candidates("thumb")])
    first = next(open_postures(HandAtObject(HAND, "pinch", T, REST, contacts), 0.015))
    untouched = [*HAND.finger_joints["middle"], *HAND.finger_joints["ring"]]
    np.testing.assert_array_equal(first[untouched], REST[untouched])
    assert (first >= HAND.lower - 1e-12).all() and (first <= HAND.upper + 1e-12).all()

    def in_object(q: np.ndarray) -> np.ndarray:
        p = points_on_links(link_poses(HAND, q[None]), HAND.contact_link[contacts], HAND.contact_points[contacts])[0]
        return p @ T[:3, :3].T + T[:3, 3]

    before, after = in_object(REST), in_object(first)
    radial = before[:, :2] / np.linalg.norm(before[:, :2], axis=1, keepdims=True)
    np.testing.assert_allclose(((after - before)[:, :2] * radial).sum(1), 0.015, atol=2e-3)
    np.testing.assert_allclose(after[:, 2], before[:, 2], atol=2e-3)


def test_directions_are_unit_and_begin_with_the_line_to_the_hand() -> None:
    T = facing_down(0.15)
    for style in ("pinch", "side"):
        directions = np.array(approach_directions(T, style))
        np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
        np.testing.assert_allclose(directions[0], T[:3, 3] / np.linalg.norm(T[:3, 3]))
    np.testing.assert_allclose(directions[1:, 2], 0)
    np.testing.assert_allclose(approach_directions(T, "pinch")[-1], [0, 0, 1])


def test_far_hand_touches_nothing_and_a_buried_one_is_counted() -> None:
    box = prepared_box((0.03, 0.03, 0.05))
    contacts = tip_candidates("index")
    free, sunk = (
        choose_approach(HandAtObject(HAND, "pinch", facing_down(height), REST, contacts), box, 0.015, [0.05])
        for height in (0.30, 0.03)
    )
    assert free.penetrations == 0 and free.length == 0.05
    assert sunk.penetrations > 20  # fingers below the table


def test_what_the_hand_carries_is_swept_too() -> None:
    box = prepared_box((0.05, 0.05, 0.10))
    T = np.eye(4)  # fingers up, palm facing +x, object in front of the palm
    T[:3, 3] = -0.08, 0.0, 0.02
    contacts = tip_candidates("ring")
    straight = REST.copy()
    straight[8:12] = 0
    held = prepared_box((0.04, 0.04, 0.04))
    carried = np.eye(4)
    carried[:3, 3] = 0.08, 0.0, -0.02  # right inside the box
    grasp = HandAtObject(HAND, "side", T, straight, contacts)
    alone = choose_approach(grasp, box, 0.03, [0.2, 0.07])
    both = choose_approach(grasp, box, 0.03, [0.2, 0.07], carried=[(held, carried)])
    assert both.penetrations > alone.penetrations + 100
