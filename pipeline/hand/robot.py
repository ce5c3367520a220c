"""A hand alone, or the Panda arm with the Allegro hand, as one URDF for loaders that want a file.

Both physics (SAPIEN) and motion planning (Pinocchio) load what is written here, so that they cannot disagree.
Mount transforms: the published robot description (see ``pipeline.hand.surface``).
"""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ElementTree
from functools import lru_cache
from pathlib import Path

from pipeline.hand.allegro import JOINT_NAMES
from pipeline.hand.assets import panda_description
from pipeline.hand.model import Hand, load_hand

ARM_JOINT_NAMES = tuple(f"panda_joint{index}" for index in range(1, 8))
ROBOT_JOINT_NAMES = ARM_JOINT_NAMES + JOINT_NAMES
MOUNT_LINK = "mount"
ARM_LINKS = tuple(f"panda_link{index}" for index in range(8))


def _with_absolute_meshes(description: Path) -> ElementTree.Element:
    root = ElementTree.parse(description).getroot()
    for mesh in root.iter("mesh"):
        mesh.set("filename", str(description.parent / mesh.get("filename", "")))
    return root


def _without_visuals(root: ElementTree.Element) -> None:
    for link in root.iter("link"):
        for visual in link.findall("visual"):
            link.remove(visual)


def _mount() -> list[ElementTree.Element]:
    text = f"""<r>
      <link name="{MOUNT_LINK}">
        <inertial>
          <mass value="0.05"/>
          <inertia ixx="2e-5" ixy="0" ixz="0" iyy="2e-5" iyz="0" izz="2e-5"/>
        </inertial>
        <collision>
          <origin xyz="0 0 0.017" rpy="-1.5707963267948966 0 0"/>
          <geometry><box size="0.05 0.034 0.065"/></geometry>
        </collision>
      </link>
      <joint name="mount_joint" type="fixed">
        <origin xyz="0 -0.02 0.107" rpy="0 0 3.141592653589793"/>
        <parent link="panda_link7"/>
        <child link="{MOUNT_LINK}"/>
      </joint>
      <joint name="hand_joint" type="fixed">
        <origin xyz="0 0.12 0.025" rpy="0 -1.5707963267948966 -1.5707963267948966"/>
        <parent link="{MOUNT_LINK}"/>
        <child link="base_link"/>
      </joint></r>"""
    return list(ElementTree.fromstring(text))


def compose_robot(arm: bool, visuals: bool, hand: Hand | None = None) -> str:
    """Return the URDF text of the hand alone or of arm, mount and hand; mesh paths are absolute.

    Args:
        arm: with the Panda arm and the mount; otherwise the root is that of the hand.
        visuals: keep visual meshes (physics without a renderer must not see any).
        hand: the Allegro when left out; no other is on the arm.
    """
    hand = hand or load_hand()
    own = _with_absolute_meshes(hand.urdf)
    if not visuals:
        _without_visuals(own)
    if not arm:
        return ElementTree.tostring(own, encoding="unicode")
    if not hand.mounted:
        raise ValueError(f"the hand {hand.name} is not on the arm")
    robot = ElementTree.Element("robot", name="panda_allegro")
    panda = _with_absolute_meshes(panda_description())
    if not visuals:
        _without_visuals(panda)
    for element in panda:
        if (
            element.tag == "link"
            and element.get("name") in ARM_LINKS
            or element.tag == "joint"
            and element.get("name") in ARM_JOINT_NAMES
        ):
            robot.append(element)
    robot.extend(_mount())
    robot.extend(element for element in own if element.tag in ("link", "joint"))
    return ElementTree.tostring(robot, encoding="unicode")


@lru_cache(maxsize=1)
def _folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="panda-allegro-")


@lru_cache(maxsize=4)
def robot_file(arm: bool, hand: Hand | None = None) -> Path:
    """Write the visual-free URDF once per process and return its path, for loaders that want a file."""
    hand = hand or load_hand()
    target = Path(_folder().name) / (f"panda_{hand.name}.urdf" if arm else f"{hand.name}.urdf")
    target.write_text(compose_robot(arm, visuals=False, hand=hand))
    return target
