"""What is proposed for a hand: a description that can be read at once, with contacts on the inner sides."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import open3d
import pytest
import trimesh
import yaml

from pipeline.hand.fitting import Solid
from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.model import hand_of_file, load_hand
from pipeline.hand.mount import Mount
from pipeline.hand.moves import finger_joints
from pipeline.hand.standard import source_file, standard_urdf
from pipeline.hand.urdf import Urdf
from pipeline.records.hands import description_file
from pipeline.records.parameters.hand import MountDescription, read_description
from tests.hand.toy import urdf_text
from tools import describe_hand
from tools.hand_guesses import Meeting, away_from_edges, groups, inner_contacts, of_solids, opposing, tip_points
from tools.mount_guess import guessed_mount
from tools.palm_press import NEEDED


def urdf_of(name: str) -> Urdf:
    file = description_file(name)
    described = read_description(file).urdf
    source = source_file(described, file.parent)
    return Urdf(standard_urdf(source, described.root, 1000.0), source)


@pytest.fixture
def hands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty place for hands and their settings, with the toy's URDF."""
    (tmp_path / "hands").mkdir()
    (tmp_path / "conf" / "hand").mkdir(parents=True)
    monkeypatch.setattr(describe_hand, "HANDS_FOLDER", tmp_path / "hands")
    (tmp_path / "toy.urdf").write_text(urdf_text())
    return tmp_path / "hands"


def test_the_toy_is_described_without_a_person(hands: Path) -> None:
    assert describe_hand.main([str(hands.parent / "toy.urdf"), "--name", "toy"]) == 0
    text = (hands / "toy" / "hand.yaml").read_text()
    assert text.count("GUESS") >= 8
    hand = hand_of_file(hands / "toy" / "hand.yaml")
    assert hand.root == "plate" and len(hand.finger_joints) == 4 and hand.joint_count == 6
    assert hand.opposing == () and hand.tips == {"left_tip", "right_tip", "far_tip"}
    np.testing.assert_allclose(hand.palm_normal, [0, 0, 1], atol=0.25)
    settings = yaml.safe_load((hands.parent / "conf" / "hand" / "toy.yaml").read_text())
    sets = settings["synthesize"]["pinch"]["finger_sets"]
    assert all(finger in hand.finger_joints for own in sets for finger in own)
    q = np.array(hand.style("pinch").posture)
    T = link_poses(hand, q[None])
    points = points_on_links(T, hand.contact_link, hand.contact_points)[0]
    normals = np.einsum("nij,nj->ni", T[0][hand.contact_link, :3, :3], hand.contact_normals)
    inward = points[:, :2] / np.linalg.norm(points[:, :2], axis=1, keepdims=True)
    assert (-(normals[:, :2] * inward).sum(1) > 0).mean() > 0.8  # of a toy about the z axis
    down = np.array(hand.style("pinch").orientation)
    np.testing.assert_allclose(down @ hand.palm_normal, [0, 0, -1], atol=1e-4)
    np.testing.assert_allclose(down @ down.T, np.eye(3), atol=1e-4)


def test_what_cannot_be_described_leaves_nothing_behind(hands: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (hands.parent / "stick.urdf").write_text('<robot name="stick"><link name="stick"/></robot>')
    for arguments, sentence in (
        (["toy.urdf", "--name", "My-Hand"], "use lower-case letters"),
        (["stick.urdf", "--name", "stick"], "a hand needs two fingers at least, and 'stick' carries 0"),
        (["none.urdf", "--name", "none"], "cannot be read"),
    ):
        given = [*arguments, "--folder", str(hands.parent)]
        assert describe_hand.main(given) == 1
        assert sentence in capsys.readouterr().err
    assert list(hands.iterdir()) == []
    (hands / "toy").mkdir()
    assert describe_hand.main(["toy.urdf", "--name", "toy", "--folder", str(hands.parent)]) == 1
    assert "there is a hand toy already" in capsys.readouterr().err


def test_the_finger_that_faces_the_others_opposes() -> None:
    def opposed(stretched: dict[str, list[float]] | None = None, **directions: list[float]) -> list[str]:
        found = Meeting(np.zeros(1), np.zeros(3), {name: np.array(own, float) for name, own in directions.items()}, 0.0)
        ways = stretched or dict.fromkeys(directions, [0.0, 0.0, 1.0])
        return opposing(found, {name: np.array(own, float) for name, own in ways.items()})

    assert opposed(a=[1, 0, 0], b=[0.9, 0.4, 0], c=[-1, 0, 0]) == ["c"]
    third = np.sqrt(3) / 2
    around = {"a": [1, 0, 0], "b": [-0.5, third, 0], "c": [-0.5, -third, 0]}
    assert opposed(**around) == []
    assert opposed({"a": [0, 0, 1], "b": [0, 1, 0], "c": [0, 0.1, 1]}, **around) == ["b"]  # points elsewhere
    assert opposed(thumb=[1, 0, 0], b=[1, 0, 0], c=[1, 0, 0]) == ["thumb"]


def test_the_allegro_pinches_and_presses_with_the_ring_finger() -> None:
    """Its published grasps: palm normal +x, fingers +z, ring against palm below the others, thumb opposing."""
    hand = load_hand("allegro")
    guesses = describe_hand.guessed(hand)
    assert guesses.opposing == ["thumb"] and guesses.press is not None and guesses.press.finger == "ring"
    np.testing.assert_allclose(guesses.face.normal, [1, 0, 0], atol=1e-6)
    content = {"fingers": {name: {} for name in hand.finger_links}, "styles": {"pinch": {}}}
    described = describe_hand.completed(content, hand, guesses, urdf_of("allegro"))
    for finger in ("index", "middle", "ring"):  # all joints at zero, by its URDF
        assert np.abs(described["fingers"][finger]["straight"]).max() < 0.15
    side = described["styles"]["side"]
    assert side["fingers"] == ["ring", "palm"] and described["styles"]["pinch"]["fingers"] == [
        "index",
        "middle",
        "thumb",
    ]
    np.testing.assert_allclose(side["orientation"], hand.style("side").orientation, atol=0.1)
    posture, joints = np.array(side["posture"]), finger_joints(["ring"], hand)
    link, point = tip_points(hand)["ring"]
    tip = points_on_links(link_poses(hand, posture[None]), np.array([link]), point[None])[0, 0]
    wanted = guesses.face.height + 2 * NEEDED  # what is between palm and tip is a cylinder of that radius
    assert posture[joints].tolist() == guesses.press.posture.round(5).tolist()
    assert wanted - 0.03 < tip[0] < wanted + 0.015
    palm = described["contacts"]["base_link"][0]
    np.testing.assert_allclose(np.array(palm["points"])[:, 0], 0.0114, atol=0.002)  # the face of its box
    np.testing.assert_allclose(palm["normals"], np.tile([1.0, 0.0, 0.0], (len(palm["normals"]), 1)), atol=1e-4)


def test_contacts_are_near_what_is_held_and_on_the_surface_that_physics_has() -> None:
    """A ball of 35 mm between the tips of the others, a cylinder of 30 mm under the ring finger."""
    hand = load_hand("allegro")
    held = describe_hand.held_by(describe_hand.guessed(hand))
    solids = describe_hand.solids_of(hand, urdf_of("allegro"))
    contacts = inner_contacts(hand, held, solids)
    fingers = list(tip_points(hand))
    assert {hand.finger_links[finger][-1] for finger in fingers} <= set(contacts)
    assert (held["ring"].radius, held["ring"].axis is None) == (0.03, False)
    owners = {name: finger for finger in fingers for name in hand.finger_links[finger]}
    for name in [name for name in contacts if name in owners]:
        (points, normals), thing = contacts[name], held[owners[name]]
        pose = link_poses(hand, thing.q[None])[0][hand.link(name)]
        away = points @ pose[:3, :3].T + pose[:3, 3] - thing.centre
        if thing.axis is not None:
            away = np.cross(np.cross(thing.axis, away), thing.axis)
        assert np.linalg.norm(away, axis=1).max() < thing.radius + 0.02
        np.testing.assert_array_less((away * (normals @ pose[:3, :3].T)).sum(1), 0.0)  # they face it
        (one,) = solids[name]
        scene = open3d.t.geometry.RaycastingScene()
        scene.add_triangles(one.hull.vertices.astype(np.float32), one.hull.faces.astype(np.uint32))
        nearest = scene.compute_closest_points(points.astype(np.float32))
        assert np.linalg.norm(nearest["points"].numpy() - points, axis=1).max() < 0.003
        assert (normals * nearest["primitive_normals"].numpy()).sum(1).min() > 0.9
    for name in hand.finger_links["index"]:  # physics has it elsewhere than the kernel
        solids[name] = [Solid(one.hull.copy().apply_translation([0, 0, 1])) for one in solids[name]]
    assert set(inner_contacts(hand, held, solids)) == set(contacts) - set(hand.finger_links["index"])


def test_the_mount_that_is_proposed_for_the_allegro_is_about_the_published_one() -> None:
    hand = load_hand("allegro")
    described, touching = guessed_mount(hand, describe_hand.guessed(hand).face)
    proposed, published = Mount(MountDescription.model_validate(described)).T_link7_hand, hand.mount.T_link7_hand
    np.testing.assert_allclose(proposed[:3, :3], published[:3, :3], atol=1e-3)
    assert np.linalg.norm(proposed[:3, 3] - published[:3, 3]) < 0.015  # m
    assert {"panda_link7", "mount", "base_link"} <= set(touching)
    assert not set(touching) & hand.tips


def test_an_edge_is_where_the_surface_ends_within_four_millimetres() -> None:
    cube, ball = (Solid(mesh) for mesh in (trimesh.creation.box((0.04,) * 3), trimesh.creation.icosphere(4, 0.012)))
    up = np.array([[0.0, 0.0, 1.0]])
    for beside, inner in ((0.0, True), (0.015, True), (0.018, False)):
        assert away_from_edges([cube], np.array([[beside, 0.0, 0.02]]), up).tolist() == [inner]
    assert away_from_edges([ball], 0.012 * up, up).tolist() == [True]  # it falls off by 0.7 mm there


def test_steps_between_fitted_boxes_are_no_contacts() -> None:
    """A wedge of two boxes: its slope keeps points of their long faces, and none of the step, which looks along it."""
    wedge = trimesh.Trimesh(
        [[0, y, z] for y in (-1, 1) for z in (-2, 2)] + [[9, y, z] for y in (-1, 1) for z in (-1, 1)]
    )
    depth, normals = of_solids(
        [Solid(wedge.convex_hull)], np.array([[4.5, 0.0, 1.5], [4.5, 0.0, 1.0], [9.5, 0.0, 0.0]])
    )
    slope = np.array([1.0, 0.0, 9.0]) / np.sqrt(82)
    np.testing.assert_allclose(normals, [slope, slope, [1, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(depth, [0.0, -0.5 * slope[2], 0.5], atol=1e-6)


def test_a_hand_whose_fingers_stand_about_the_palm_presses_nothing() -> None:
    guesses = describe_hand.guessed(load_hand("dclaw"))
    assert guesses.press is None and guesses.opposing == []
    np.testing.assert_allclose(guesses.face.normal, [0, 0, 1], atol=1e-4)


def test_groups_cover_all_pairs_and_nothing_else() -> None:
    pairs = [("a", "b"), ("b", "c"), ("a", "c"), ("c", "d")]
    found = groups(pairs)
    assert found == [["a", "b", "c"], ["c", "d"]]
