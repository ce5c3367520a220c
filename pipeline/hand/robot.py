"""A hand alone, or the Panda arm with the hand on its mount, as one URDF for loaders that want a file.

Both physics (SAPIEN) and motion planning (Pinocchio) load what is written here, so that they cannot disagree.
"""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ElementTree
from functools import lru_cache
from pathlib import Path

from pipeline.hand.allegro import JOINT_NAMES
from pipeline.hand.assets import panda_description
from pipeline.hand.model import Hand

ARM_JOINT_NAMES = tuple(f"panda_joint{index}" for index in range(1, 8))
ROBOT_JOINT_NAMES = ARM_JOINT_NAMES + JOINT_NAMES  # until plan takes the hand
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


def robot_joint_names(hand: Hand) -> tuple[str, ...]:
    """Return the joints of the arm with the hand, in the order of every table's ``robot_q``."""
    return ARM_JOINT_NAMES + hand.joint_names


def compose_robot(arm: bool, visuals: bool, hand: Hand) -> str:
    """Return the URDF text of the hand alone or of arm, mount and hand; mesh paths are absolute.

    Args:
        arm: with the Panda arm and the mount; otherwise the root is that of the hand.
        visuals: keep visual meshes (physics without a renderer must not see any).
        hand: with ``arm`` one that has a mount.
    """
    own = _with_absolute_meshes(hand.urdf)
    if not visuals:
        _without_visuals(own)
    if not arm:
        return ElementTree.tostring(own, encoding="unicode")
    if hand.mount is None:
        raise ValueError(f"the hand {hand.name} is not on the arm")
    robot = ElementTree.Element("robot", name=f"panda_{hand.name}")
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
    robot.extend(hand.mount.elements(hand.root))
    robot.extend(element for element in own if element.tag in ("link", "joint"))
    return ElementTree.tostring(robot, encoding="unicode")


@lru_cache(maxsize=1)
def _folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="robot-")


@lru_cache(maxsize=4)
def robot_file(arm: bool, hand: Hand) -> Path:
    """Write the visual-free URDF once per process and return its path, for loaders that want a file."""
    target = Path(_folder().name) / (f"panda_{hand.name}.urdf" if arm else f"{hand.name}.urdf")
    target.write_text(compose_robot(arm, visuals=False, hand=hand))
    return target
