"""Hands that installed packages bring, coupled and sliding ones too, against pytorch_kinematics."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.hand.assets import robot_assets
from pipeline.hand.model import hand_of_file
from pipeline.hand.shapes import MOST_SHAPES
from tests.hand.described import write_description
from tests.hand.oracles import pytorch_errors

# Independent joints, and how many follow them.
HANDS = {
    "ability_hand/ability_hand_right_glb.urdf": (6, 4),
    "inspire_hand/RH56DFX-2LR/urdf/inspire_hand_right.urdf": (6, 6),
    "trifinger/trifingerpro.urdf": (9, 0),
    "panda/panda_v2.urdf": (1, 1),
    "allegro/allegro_hand_left_glb.urdf": (16, 0),
    "xarm7/xarm7_ability_right_hand.urdf": (6, 4),
}


@pytest.mark.parametrize("name", HANDS)
def test_links_and_jacobians_equal_pytorch_kinematics(name: str, tmp_path: Path) -> None:
    pytest.importorskip("pytorch_kinematics")
    source = robot_assets() / name
    hand = hand_of_file(write_description(tmp_path / "hand", source, {"shape_error": 0.02}))
    assert (hand.joint_count, len(hand.physical.names) - hand.joint_count) == HANDS[name]
    assert len(hand.box_link) + len(hand.sphere_link) <= MOST_SHAPES
    pose, slope = pytorch_errors(hand, source.read_bytes(), rows=2)
    assert pose < 1e-6 and slope < 1e-6  # it computes axes in single precision


def test_the_panda_s_fingers_slide_alike(tmp_path: Path) -> None:
    hand = hand_of_file(write_description(tmp_path / "panda", robot_assets() / "panda/panda_v2.urdf"))
    assert hand.root == "panda_hand" and hand.joint_names == ("panda_finger_joint1",)
    assert hand.finger_joints == {"panda_leftfinger": (0,), "panda_rightfinger": (), "palm": ()}
    assert hand.slides[[hand.link("panda_leftfinger"), hand.link("panda_rightfinger")]].all()
    assert hand.lower.tolist() == [0.0] and hand.upper.tolist() == [0.04]
