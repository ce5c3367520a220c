"""Coupled and sliding joints: limits, positions, drives, and what does not fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio
import pytest

from pipeline.hand.kinematics import link_poses
from pipeline.hand.model import Hand, hand_of_file
from pipeline.hand.robot import robot_file
from pipeline.records.errors import UserError
from pipeline.records.parameters.physics import PhysicsParameters
from tests.hand.oracles import pytorch_errors
from tests.hand.toy import coupled_changes, coupled_urdf, write_coupled, write_toy


@pytest.fixture(scope="module")
def coupled(tmp_path_factory: pytest.TempPathFactory) -> Hand:
    return hand_of_file(write_coupled(tmp_path_factory.mktemp("hands") / "coupled"))


def test_limits_are_cut_to_what_followers_can_do(coupled: Hand) -> None:
    assert coupled.joint_names == ("left_turn", "right_turn", "right_bend", "far_turn")
    assert coupled.physical.names[4:] == ("left_bend", "far_bend")
    # left_bend = 1.2 left_turn - 0.1 in [-0.2, 1.5]; far_bend = -20 far_turn + 0.3 in [-0.2, 1.5]
    np.testing.assert_allclose(coupled.lower, [max(-0.4, -0.1 / 1.2), -0.4, -0.2, max(-0.04, -1.2 / 20)])
    np.testing.assert_allclose(coupled.upper, [min(1.4, 1.6 / 1.2), 1.4, 1.5, min(0.03, 0.5 / 20)])


def test_links_and_jacobians_equal_pytorch_kinematics(coupled: Hand) -> None:
    pytest.importorskip("pytorch_kinematics")
    pose, slope = pytorch_errors(coupled, coupled.standard_urdf, rows=2)
    assert pose < 1e-6 and slope < 1e-6


def test_what_loaders_take_has_all_joints_and_no_coupling(coupled: Hand) -> None:
    text = robot_file(False, coupled).read_text()
    assert "mimic" not in text and "mimic" in coupled.standard_urdf
    model = pinocchio.buildModelFromXML(text)
    assert model.nq == 6
    columns = [model.joints[model.getJointId(name)].idx_q for name in coupled.physical.names]
    q = np.array([0.7, 0.2, 0.3, 0.01])
    configuration = np.zeros(6)
    configuration[columns] = coupled.physical.positions(q)
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, configuration)
    for name, pose in zip(coupled.link_names, link_poses(coupled, q[None])[0], strict=True):
        np.testing.assert_allclose(pose, data.oMf[model.getFrameId(name)].homogeneous, atol=1e-12)


def test_drives_are_those_of_physics_but_where_the_description_says(tmp_path: Path, coupled: Hand) -> None:
    settings = PhysicsParameters()
    stiffness, damping, limit = coupled.physical.drives(settings)
    usual = (settings.hand_stiffness, settings.hand_damping, settings.hand_torque_limit)
    assert (stiffness[0], damping[0], limit[0]) == usual
    assert (stiffness[3], damping[3], limit[3]) == (4000.0, 100.0, 40.0)  # it slides: the URDF's effort, N
    given = {"limits_of_urdf": True, "joints": {**coupled_changes()["drives"]["joints"], "left_bend": {"limit": 2.0}}}
    changes = {**coupled_changes(), "drives": given}
    other = hand_of_file(write_toy(tmp_path / "toy", changes, coupled_urdf()))
    np.testing.assert_array_equal(other.physical.drives(settings)[2], [5.0, 5.0, 5.0, 40.0, 2.0, 5.0])


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"drives": {}}, "'far_turn' slides, and physics' drives are those of turning joints; give it stiffness"),
        ({"drives": {"joints": {"elbow": {}}}}, "drives.joints names 'elbow', which is no moving joint"),
    ],
)
def test_a_mistake_in_drives_is_answered_with_a_sentence(tmp_path: Path, changes: dict, sentence: str) -> None:
    with pytest.raises(UserError, match=sentence):
        hand_of_file(write_toy(tmp_path / "toy", {**coupled_changes(), **changes}, coupled_urdf()))


def test_couplings_that_no_position_satisfies_are_refused(tmp_path: Path) -> None:
    text = coupled_urdf().replace('multiplier="1.2" offset="-0.1"', 'multiplier="1.2" offset="5"')
    with pytest.raises(UserError, match="'left_turn' and those that follow it have limits .* no position satisfies"):
        hand_of_file(write_toy(tmp_path / "toy", coupled_changes(), text))


def test_couplings_follow_one_another(tmp_path: Path) -> None:
    text = coupled_urdf().replace(
        '<parent link="right_near"/><child link="right_tip"/>',
        '<parent link="right_near"/><child link="right_tip"/><mimic joint="left_bend" multiplier="0.5" offset="0.02"/>',
    )
    changes = coupled_changes()
    changes["joints"].remove("right_bend")
    changes["fingers"]["right"]["joints"] = ["right_turn"]
    changes["styles"]["pinch"]["posture"] = [0.1, 0.1, 0.0]
    hand = hand_of_file(write_toy(tmp_path / "toy", changes, text))
    positions = dict(zip(hand.physical.names, hand.physical.positions([0.5, 0.1, 0.0]), strict=True))
    assert positions["left_bend"] == pytest.approx(1.2 * 0.5 - 0.1)
    assert positions["right_bend"] == pytest.approx(0.5 * (1.2 * 0.5 - 0.1) + 0.02)
