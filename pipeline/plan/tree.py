"""Where every link of the robot is in a posture: the tree of frames that ROS calls TF."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio
from numpy.typing import NDArray

from pipeline.hand.model import Hand
from pipeline.hand.robot import compose_robot, robot_joint_names
from pipeline.records.poses import inverse_pose


@dataclass(frozen=True)
class Branch:
    """A link on the link that carries it."""

    parent: str
    child: str
    moves: bool


class RobotTree:
    """The frames of arm, mount and hand.

    Attributes:
        branches: all links but the root, each with the one that carries it.
        root: the link that is at the world's origin.
    """

    def __init__(self, hand: Hand) -> None:
        description = compose_robot(True, visuals=False, hand=hand)
        joints = ElementTree.fromstring(description).findall("joint")
        self.branches = [
            Branch(_link(joint, "parent"), _link(joint, "child"), joint.get("type") != "fixed") for joint in joints
        ]
        children = {branch.child for branch in self.branches}
        self.root = next(branch.parent for branch in self.branches if branch.parent not in children)
        self._model: Any = pinocchio.buildModelFromXML(description)
        self._data: Any = self._model.createData()
        names = robot_joint_names(hand)
        self._index = np.array([self._model.joints[self._model.getJointId(name)].idx_q for name in names])

    def poses(self, q: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
        """Return ``T_root_link`` (4, 4) of every link at joints (R,), rad."""
        configuration = np.zeros(self._model.nq)
        configuration[self._index] = q
        pinocchio.framesForwardKinematics(self._model, self._data, configuration)
        links = [self.root, *(branch.child for branch in self.branches)]
        return {name: self._data.oMf[self._model.getFrameId(name)].homogeneous.copy() for name in links}

    def relative(self, q: NDArray[np.float64]) -> dict[Branch, NDArray[np.float64]]:
        """Return ``T_parent_child`` (4, 4) of every branch at joints (R,), rad."""
        T = self.poses(q)
        return {branch: inverse_pose(T[branch.parent]) @ T[branch.child] for branch in self.branches}


def _link(joint: ElementTree.Element, which: str) -> str:
    element = joint.find(which)
    return "" if element is None else element.get("link", "")
