"""Any described hand: its arrays against Pinocchio, and one sentence for every mistake in a description."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from pipeline.hand.contacts import distance_to_shapes
from pipeline.hand.kinematics import link_poses, point_jacobian
from pipeline.hand.model import Hand, hand_of_file, load_hand
from pipeline.hand.moves import finger_joints, move_points, straight
from pipeline.hand.surface import hand_surface
from pipeline.records.errors import UserError
from pipeline.records.hands import known_hands
from tests.hand.toy import FINGERS, TIP, description, urdf_text, write_toy


@pytest.fixture(scope="module")
def toy(tmp_path_factory: pytest.TempPathFactory) -> Hand:
    return hand_of_file(write_toy(tmp_path_factory.mktemp("hands") / "toy"))


@pytest.fixture(params=["toy", *known_hands()])
def hand(request: pytest.FixtureRequest, toy: Hand) -> Hand:
    return toy if request.param == "toy" else load_hand(request.param)


def test_kinematics_and_limits_agree_with_pinocchio(hand: Hand) -> None:
    pinocchio = pytest.importorskip("pinocchio")
    model = pinocchio.buildModelFromXML(hand.standard_urdf)
    columns = [model.joints[model.getJointId(name)].idx_q for name in hand.joint_names]
    assert model.nq == hand.joint_count
    np.testing.assert_allclose(hand.lower, model.lowerPositionLimit[columns])
    np.testing.assert_allclose(hand.upper, model.upperPositionLimit[columns])
    data, rng = model.createData(), np.random.default_rng(1)
    for q in rng.uniform(hand.lower, hand.upper, (5, hand.joint_count)):
        configuration = np.zeros(model.nq)
        configuration[columns] = q
        pinocchio.framesForwardKinematics(model, data, configuration)
        T = link_poses(hand, q[None])[0]
        root = data.oMf[model.getFrameId(hand.link_names[0])].homogeneous
        for name, mine in zip(hand.link_names, T, strict=True):
            theirs = np.linalg.inv(root) @ data.oMf[model.getFrameId(name)].homogeneous
            np.testing.assert_allclose(mine, theirs, atol=1e-9)
        link = int(hand.contact_link[-1])
        point, step = T[link][:3, 3] + T[link][:3, :3] @ hand.contact_points[-1], 1e-6
        J = point_jacobian(hand, T, link, point)
        for joint in range(hand.joint_count):
            moved = link_poses(hand, (q + step * np.eye(hand.joint_count)[joint])[None])[0, link]
            slope = (moved[:3, :3] @ hand.contact_points[-1] + moved[:3, 3] - point) / step
            np.testing.assert_allclose(J[:, joint], slope, atol=1e-5)


def test_candidates_and_samples_lie_on_the_shapes_and_normals_point_out(hand: Hand) -> None:
    def distances(links: np.ndarray, points: np.ndarray) -> np.ndarray:
        found = np.empty(len(points))
        for link in set(links.tolist()):
            boxes = [
                (T, h) for own, T, h in zip(hand.box_link, hand.box_pose, hand.box_half, strict=True) if own == link
            ]
            balls = [
                (c, float(r))
                for own, c, r in zip(hand.sphere_link, hand.sphere_centre, hand.sphere_radius, strict=True)
                if own == link
            ]
            found[links == link] = distance_to_shapes(points[links == link], boxes, balls)
        return found

    assert np.abs(distances(hand.contact_link, hand.contact_points)).max() < 5e-4
    outside = distances(hand.contact_link, hand.contact_points + 2e-3 * hand.contact_normals)
    assert outside.min() > 1e-3
    np.testing.assert_allclose(np.linalg.norm(hand.contact_normals, axis=1), 1.0)
    links, points = hand_surface(300, hand)
    assert distances(links, points).max() < 1e-9  # on a shape, or inside another one of the link


def test_links_without_shapes_are_kept_where_something_hangs_on_them(toy: Hand) -> None:
    assert toy.link_names[:4] == ("plate", "left_mount", "left_near", "left_tip")
    assert "camera" not in toy.link_names and len(toy.link_names) == 10
    assert (toy.parent < np.arange(10)).all()
    np.testing.assert_allclose(np.linalg.norm(toy.axis[toy.joint >= 0], axis=1), 1.0)  # the URDF has one of length 2
    assert toy.sphere_radius.tolist() == [TIP] * 3
    assert toy.mount is None and toy.name == "toy"


def test_a_hand_is_one_object_and_travels_as_its_file(hand: Hand) -> None:
    assert pickle.loads(pickle.dumps(hand)) is hand
    assert len(pickle.dumps(hand)) < 1000


def test_moves_use_the_fingers_of_the_description(toy: Hand) -> None:
    q = np.array([0.3, 0.4] * 3)
    joints = finger_joints(["right"], toy)
    assert joints.tolist() == [2, 3]
    tip = toy.link("right_tip")
    inward = link_poses(toy, q[None])[0, tip, :3, 3] * [-1, -1, 0]
    moved = move_points(toy, q, [tip], np.zeros((1, 3)), 0.005 * inward[None] / np.linalg.norm(inward), joints)
    assert (moved[[0, 1, 4, 5]] == q[[0, 1, 4, 5]]).all() and moved[2] > q[2]
    np.testing.assert_array_equal(straight(["ring", "index"], load_hand("allegro")), [0, -0.1, 0, 0] * 2)


LEFT = description()["fingers"]["left"]
BROKEN = [
    ({"joints": ["left_turn", "left_turn"]}, "joints lists a joint twice"),
    ({"joints": description()["joints"][:-1]}, "'far_bend' is not in joints"),
    ({"joints": [*description()["joints"], "wrist"]}, "the joint 'wrist' is in no finger"),
    ({"tips": ["left_pad"]}, "tips names the link 'left_pad', which toy.urdf does not have"),
    ({"opposing": ["thumb"]}, "opposing: 'thumb' is not a finger; use left, right, far, palm"),
    ({"never_meeting": [["plate", "mount"]]}, "never_meeting names the link 'mount', which toy.urdf does not have"),
    ({"urdf": {"path": "other.urdf"}}, "there is no URDF .*other.urdf; correct `urdf` there"),
    ({"urdf": {"package": "no_such", "path": "x.urdf"}}, "the package no_such is not installed"),
    ({"shapes": {"left_tip": {"boxes": [{"centre": [0, 0, 0.02], "size": [0.02, 0.01, 0.03]}]}}}, "has no ball 0"),
    ({"contacts": {"plate": [{"points": [[0, 0, 0.02]], "normals": [[0, 0, 1]]}]}}, "0 is 10.0 mm off the link's"),
    ({"contacts": {"left_mount": [{"points": [[0, 0, 0]], "normals": [[0, 0, 1]]}]}}, "in no finger; add it to one"),
    ({"contacts": {"left_tip": [{"normal": "+x"}]}}, "give exactly one of grid, cap and points"),
    (
        {"contacts": {"left_tip": [{"cap": {**description()["contacts"]["left_tip"][1]["cap"], "front": "+z"}}]}},
        "front must be perpendicular to axis",
    ),
    ({"styles": {"pinch": {**description()["styles"]["pinch"], "posture": [0.0]}}}, "posture needs 6 angles"),
    ({"styles": {"pinch": {**description()["styles"]["pinch"], "held": ["ring"]}}}, "held: 'ring' is not a finger"),
    (
        {"styles": {"pinch": {**description()["styles"]["pinch"], "fingers": ["left", "hook"]}}},
        "fingers: 'hook' is not a finger",
    ),
    (
        {
            "fingers": {
                **description()["fingers"],
                "left": {**LEFT, "holding": {"first": [0], "bent": [[0, 1], [1, 1]]}},
            }
        },
        "fingers.left.holding.bent needs an angle per joint after the first",
    ),
    ({"styles": {"hook": description()["styles"]["pinch"]}}, "styles.hook"),
    ({"colour": "red"}, "colour: unknown field"),
    ({"fingers": {"left+right": {"links": ["plate"]}}}, "the finger name 'left\\+right': use lower-case letters"),
]


@pytest.mark.parametrize(("changes", "sentence"), BROKEN, ids=[sentence[:40] for _, sentence in BROKEN])
def test_a_mistake_in_a_description_is_answered_with_a_sentence(tmp_path: Path, changes, sentence: str) -> None:
    with pytest.raises(UserError, match=sentence) as caught:
        hand_of_file(write_toy(tmp_path / "toy", changes))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('type="revolute"', 'type="planar"', "'left_turn' of toy.urdf is planar; make it revolute or prismatic"),
        ('type="revolute"', 'type="prismatic"', "'left_turn' slides, .* give it stiffness, damping and limit"),
        ("<axis", '<mimic joint="far_bend"/><axis', "joints names 'left_turn', which follows 'far_bend'; remove it"),
        ("<axis", '<mimic joint="left_turn"/><axis', "'left_turn' of toy.urdf follows itself; mend its mimic"),
        ("<axis", '<mimic joint="elbow"/><axis', "'left_turn' of toy.urdf follows 'elbow', which does not move"),
        ('lower="-0.4"', 'lower="2.4"', "'left_turn' of toy.urdf needs limits, lower < upper"),
        ('<sphere radius="0.008"/>', '<mesh filename="a.stl"/>', "there is no mesh a.stl in the folder"),
        ("</robot>", "", "is not XML"),
        ('xyz="0 0 0.03"', 'xyz="0 0 high"', "the URDF has a value that is no number .*high"),
        ('link name="camera"', 'link name="lens"', "the joint 'camera_joint' has no child link"),
    ],
)
def test_a_urdf_that_cannot_be_used_is_answered_with_a_sentence(tmp_path: Path, old, new, sentence) -> None:
    text = urdf_text()
    assert old in text
    with pytest.raises(UserError, match=sentence):
        hand_of_file(write_toy(tmp_path / "toy", urdf=text.replace(old, new)))


def test_a_joint_of_the_urdf_that_is_not_described_is_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="the joint 'far_turn' of toy.urdf moves; add it to joints"):
        hand_of_file(
            write_toy(
                tmp_path / "toy",
                {
                    "joints": description()["joints"][:4],
                    "fingers": {name: own for name, own in description()["fingers"].items() if name != FINGERS[2]},
                    "styles": {
                        "pinch": {**description()["styles"]["pinch"], "fingers": FINGERS[:2], "posture": [0.0] * 4}
                    },
                },
            )
        )


def test_all_mistakes_are_told_at_once(tmp_path: Path) -> None:
    file = write_toy(
        tmp_path / "toy",
        {"tips": ["left_pad"], "joints": [*description()["joints"], "wrist"], "colour": "red", "palm_normal": [0, 1]},
    )
    with pytest.raises(UserError, match=r"has 2 mistakes: \(1\) palm_normal.*\(2\) colour: unknown") as caught:
        hand_of_file(file)
    assert "\n" not in str(caught.value)
    text = urdf_text().replace('lower="-0.4"', 'lower="2.4"')
    with pytest.raises(
        UserError, match=r"has 4 mistakes: .*'left_pad'.*'left_turn' of.*'right_turn' of.*'far_turn' of"
    ):
        hand_of_file(write_toy(tmp_path / "other", {"tips": ["left_pad"]}, text))


def test_an_unknown_hand_and_an_unknown_style_name_those_there_are() -> None:
    with pytest.raises(UserError, match="no hand 'claw'; describe it in hands/claw/hand.yaml, or use one of allegro"):
        load_hand("claw")
    with pytest.raises(UserError, match="the hand dclaw has no style 'side'; use pinch, or describe it"):
        load_hand("dclaw").style("side")
