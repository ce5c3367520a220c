"""A made-up MJCF with everything that makes reading one hard, against MuJoCo itself."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest

from pipeline.hand.model import hand_of_file
from pipeline.records.errors import UserError
from tests.hand.described import write_description
from tests.hand.oracles import mujoco_errors

FINGER = """
  <body name="{name}_near" pos="{x} 0 0.03" euler="0 {turn} 30">
    <joint name="{name}_spread" axis="1 0 0" pos="0 0.004 0" range="-0.4 0.5"/>
    <joint name="{name}_bend" class="bend"/>
    <geom type="capsule" fromto="0 0 0 0 0 0.03" size="0.008"/>
    <body name="{name}_middle" pos="0 0 0.04">
      <joint name="{name}_first" class="bend" ref="0.2"/>
      <geom type="cylinder" size="0.007 0.01" pos="0 0 0.01"/>
      <body name="{name}_tip" pos="0 0 0.03">
        <joint name="{name}_second" class="bend"/>
        <geom type="ellipsoid" size="0.008 0.008 0.012" pos="0 0 0.012"/>
      </body>
    </body>
  </body>"""
MJCF = """
<mujoco model="hand">
  <compiler angle="radian" autolimits="true"/>
  <default>
    <default class="bend"><joint axis="0 1 0.2" range="-0.1 1.4"/></default>
  </default>
  <worldbody>
    <body name="base"><freejoint/>
      <geom type="box" size="0.04 0.02 0.01" euler="0 0 0.3"/>
      {fingers}
      <body name="slider" pos="0 0.05 0"><joint name="slide" type="slide" axis="0 0 1" range="0 0.03"/>
        <geom size="0.01"/></body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="one_pull"><joint joint="one_first" coef="1"/><joint joint="one_second" coef="0.5"/></fixed>
  </tendon>
  <equality><joint joint1="two_second" joint2="two_first" polycoef="0.05 0.8 0 0 0"/></equality>
  <actuator>
    {motors}
    <position tendon="one_pull" forcerange="-2 2"/>
    <position joint="two_first" forcerange="-1.5 1.5"/>
    <position joint="slide" forcerange="-9 9"/>
  </actuator>
</mujoco>"""


def text() -> str:
    fingers = FINGER.format(name="one", x=0.03, turn=0.2) + FINGER.format(name="two", x=-0.03, turn=-0.3)
    motors = "".join(f'<position joint="{name}_{joint}"/>' for name in ("one", "two") for joint in ("spread", "bend"))
    return MJCF.format(fingers=fingers, motors=motors)


def test_bodies_and_jacobians_are_where_mujoco_has_them(tmp_path: Path) -> None:
    file = tmp_path / "made" / "hand.xml"
    file.parent.mkdir()
    file.write_text(text())
    hand = hand_of_file(write_description(tmp_path / "hand", file))
    pose, slope = mujoco_errors(hand, file)
    assert pose < 1e-9 and slope < 1e-9
    follows = dict(zip(hand.physical.names, hand.physical.driver, strict=True))
    assert hand.joint_count == 7 and hand.physical.names[7:] == ("one_second", "two_second")
    assert hand.joint_names[follows["one_second"]] == "one_first"
    np.testing.assert_allclose(hand.physical.multiplier[7:], [0.5, 0.8])
    np.testing.assert_allclose(hand.physical.offset[7:], [0.0, 0.05 - 0.8 * 0.2])  # both from where they rest
    efforts = {
        joint.get("name"): float(joint.find("limit").get("effort"))
        for joint in ElementTree.fromstring(hand.standard_urdf).iter("joint")
        if joint.find("limit") is not None
    }
    assert efforts["one_first"] == 2 and efforts["one_second"] == 1 and efforts["two_first"] == 1.5
    assert efforts["slide"] == 9 and efforts["one_bend"] == 0


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('<position joint="slide" forcerange="-9 9"/>', "", "no actuator moves the joint 'slide'"),
        ('polycoef="0.05 0.8 0 0 0"', 'polycoef="0 1 2 0 0"', "'two_second' follows another one by a curve"),
        ('<joint name="slide" type="slide"', '<joint name="slide" type="ball"', "cannot be read by MuJoCo|one axis"),
        ("<equality>", '<equality><connect body1="one_tip" body2="two_tip" anchor="0 0 0"/>', "closes a loop of links"),
        ("<worldbody>", "<worldbody", "is not XML"),
        ('class="bend"/>', 'class="bow"/>', "cannot be read by MuJoCo"),
    ],
)
def test_what_cannot_be_read_is_answered_with_a_sentence(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    made = text()
    assert old in made
    file = tmp_path / "hand.xml"
    file.write_text(made.replace(old, new))
    with pytest.raises(UserError, match=sentence) as caught:
        write_description(tmp_path / "hand", file)
    assert "\n" not in str(caught.value)
