"""A hand alone, or the Panda arm with the hand on its mount, as one URDF for loaders that want a file.

Both physics (SAPIEN) and motion planning (Pinocchio) load what is written here, so that they cannot disagree.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.hand.assets import panda_description
from pipeline.hand.model import Hand
from pipeline.hand.standard import generated_folder
from pipeline.records.errors import UserError

ARM_JOINT_NAMES = tuple(f"panda_joint{index}" for index in range(1, 8))
ARM_LINKS = tuple(f"panda_link{index}" for index in range(8))


def require_arm(hand: Hand) -> None:
    """Check that a hand is on the arm.

    Raises:
        UserError: it is not.
    """
    if hand.mount is None:
        raise UserError(
            f"the hand {hand.name} is on no arm, so that there are no robot trials and no report; describe its `mount` "
            f"in {hand.source}, or run `./dev repro sample@learned` for grasps without an arm."
        )


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


def all_joint_names(arm: bool, hand: Hand) -> tuple[str, ...]:
    """Return all joints of the URDF: the arm's, if it is there, and the hand's, those that follow others last."""
    return (ARM_JOINT_NAMES if arm else ()) + hand.physical.names


def all_positions(arm: bool, hand: Hand, q: ArrayLike) -> NDArray[np.float64]:
    """Return positions (..., n) of :func:`all_joint_names` for those of the arm and of independent joints, ``q``."""
    own = np.asarray(q, np.float64)
    if not hand.physical.coupled:
        return own
    count = len(ARM_JOINT_NAMES) if arm else 0
    return np.concatenate([own[..., :count], hand.physical.positions(own[..., count:])], axis=-1)


def compose_robot(arm: bool, visuals: bool, hand: Hand) -> str:
    """Return the URDF text of the hand alone or of arm, mount and hand; mesh paths are absolute, no joint is coupled.

    Args:
        arm: with the Panda arm and the mount; otherwise the root is that of the hand.
        visuals: keep visual meshes (physics without a renderer must not see any).
        hand: with ``arm`` one that has a mount.
    """
    own = ElementTree.fromstring(hand.standard_urdf)
    for joint in own.iter("joint"):
        for mimic in joint.findall("mimic"):  # every joint is driven by itself, see ``hand.joints``
            joint.remove(mimic)
    if not visuals:
        _without_visuals(own)
    if not arm:
        return ElementTree.tostring(own, encoding="unicode")
    assert hand.mount is not None, hand.name
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


@lru_cache(maxsize=4)
def robot_file(arm: bool, hand: Hand) -> Path:
    """Write the visual-free URDF once per process and return its path, for loaders that want a file."""
    target = generated_folder() / (f"panda_{hand.name}.urdf" if arm else f"{hand.name}.urdf")
    target.write_text(compose_robot(arm, visuals=False, hand=hand))
    return target
