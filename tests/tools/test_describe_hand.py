"""What is proposed for a hand: a description that can be read at once, with contacts on the inner sides."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.model import hand_of_file
from tests.hand.toy import urdf_text
from tools import describe_hand
from tools.hand_guesses import Meeting, groups, opposing


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
    def found(**directions: list[float]) -> Meeting:
        return Meeting(np.zeros(1), np.zeros(3), {name: np.array(own, float) for name, own in directions.items()}, 0.0)

    assert opposing(found(a=[1, 0, 0], b=[0.9, 0.4, 0], c=[-1, 0, 0])) == ["c"]
    third = np.sqrt(3) / 2
    assert opposing(found(a=[1, 0, 0], b=[-0.5, third, 0], c=[-0.5, -third, 0])) == []
    assert opposing(found(thumb=[1, 0, 0], b=[1, 0, 0], c=[1, 0, 0])) == ["thumb"]


def test_groups_cover_all_pairs_and_nothing_else() -> None:
    pairs = [("a", "b"), ("b", "c"), ("a", "c"), ("c", "d")]
    found = groups(pairs)
    assert found == [["a", "b", "c"], ["c", "d"]]
