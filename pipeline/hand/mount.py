"""What joins a hand to the arm: frames, collision box and links of a mount, from the hand's description."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.urdf import frame_matrix
from pipeline.records.parameters.hand import FLANGE_LINK, MOUNT_LINK, MountDescription, PoseDescription

DECIMALS = 12  # of a mount's frames: right angles in radians are not exact, their sines and cosines are to be


def _frame(pose: PoseDescription) -> NDArray[np.float64]:
    return _rounded(frame_matrix(pose.xyz, pose.rpy))


def _rounded(T: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.round(T, DECIMALS) + 0.0  # no negative zeros


@dataclass(frozen=True, eq=False)
class Mount:
    """A rigid body between the arm's flange, ``panda_link7``, and the root of the hand; SI units."""

    description: MountDescription

    @cached_property
    def T_link7_mount(self) -> NDArray[np.float64]:
        """(4, 4) of the mount in the flange's frame."""
        return _frame(self.description.origin)

    @cached_property
    def T_link7_hand(self) -> NDArray[np.float64]:
        """(4, 4) of the hand's root in the flange's frame."""
        return _rounded(self.T_link7_mount @ _frame(self.description.hand))

    @cached_property
    def T_link7_box(self) -> NDArray[np.float64]:
        """(4, 4) of the collision box in the flange's frame."""
        return self.T_link7_mount @ _frame(self.description.box.origin)

    @cached_property
    def box_half(self) -> NDArray[np.float64]:
        """(3,) half extents of the collision box."""
        return np.array(self.description.box.size) / 2

    def elements(self, root: str) -> list[ElementTree.Element]:
        """Return the URDF elements from the flange to the link ``root`` of the hand: the mount and two fixed joints."""
        own = self.description
        ixx, iyy, izz = own.inertia
        text = f"""<r>
          <link name="{MOUNT_LINK}">
            <inertial>
              <mass value="{own.mass}"/>
              <inertia ixx="{ixx}" ixy="0" ixz="0" iyy="{iyy}" iyz="0" izz="{izz}"/>
            </inertial>
            <collision>
              {_origin(own.box.origin)}
              <geometry><box size="{_numbers(own.box.size)}"/></geometry>
            </collision>
          </link>
          <joint name="mount_joint" type="fixed">
            {_origin(own.origin)}
            <parent link="{FLANGE_LINK}"/>
            <child link="{MOUNT_LINK}"/>
          </joint>
          <joint name="hand_joint" type="fixed">
            {_origin(own.hand)}
            <parent link="{MOUNT_LINK}"/>
            <child link="{root}"/>
          </joint></r>"""
        return list(ElementTree.fromstring(text))


def _origin(pose: PoseDescription) -> str:
    return f'<origin xyz="{_numbers(pose.xyz)}" rpy="{_numbers(pose.rpy)}"/>'


def _numbers(values: tuple[float, float, float]) -> str:
    return " ".join(str(value) for value in values)
