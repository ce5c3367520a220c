"""What is read from a URDF: transforms, the tree of links, joints, collision boxes and balls."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

UNTURNED = 1e-9  # how far a box's rotation may be from none
SLIDING = "prismatic"


def vector(text: str | None) -> NDArray[np.float64]:
    """Return the numbers of an attribute such as ``xyz``; zeros where it is missing."""
    return np.array([float(part) for part in (text or "0 0 0").split()])


def origin_matrix(element: ElementTree.Element | None) -> NDArray[np.float64]:
    """Return the 4x4 of a URDF ``<origin>``."""
    return np.eye(4) if element is None else frame_matrix(vector(element.get("xyz")), vector(element.get("rpy")))


def frame_matrix(xyz: ArrayLike, rpy: ArrayLike) -> NDArray[np.float64]:
    """Return the 4x4 of a position (3,), m, and of extrinsic xyz angles (3,), rad (R = Rz Ry Rx)."""
    T = np.eye(4)
    (sr, sp, sy), (cr, cp, cy) = (f(np.asarray(rpy, np.float64)) for f in (np.sin, np.cos))
    T[:3, :3] = (
        np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
        @ np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
        @ np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    )
    T[:3, 3] = xyz
    return T


def rpy_of(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angles (3,), rad, for which :func:`frame_matrix` has the rotation ``R`` (3, 3)."""
    level = np.hypot(R[0, 0], R[1, 0])
    pitch = np.arctan2(-R[2, 0], level)
    if level < 1e-12:  # roll and yaw turn about the same axis
        return np.array([np.arctan2(-R[1, 2], R[1, 1]), pitch, 0.0])
    return np.array([np.arctan2(R[2, 1], R[2, 2]), pitch, np.arctan2(R[1, 0], R[0, 0])])


def end_of(joint: ElementTree.Element, end: str) -> str:
    """Return the name of the ``parent`` or ``child`` link of a joint, '' where it has none."""
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


@dataclass(frozen=True)
class Follower:
    """How a joint follows another one: its position is ``multiplier`` times the other's, plus ``offset``."""

    joint: str  # the independent joint that drives it
    multiplier: float
    offset: float  # rad, or m where it slides


class Urdf:
    """The elements of a URDF by name; mistakes are collected in ``mistakes`` rather than raised one by one.

    Args:
        root: of a URDF in standard form, see ``pipeline.hand.standard``.
        file: where it comes from.
    """

    def __init__(self, root: ElementTree.Element, file: Path) -> None:
        self.file = file
        self.mistakes: list[str] = []
        self.links = {link.get("name", ""): link for link in root.findall("link")}
        self.joints = {joint.get("name", ""): joint for joint in root.findall("joint")}
        self.joint_of_child = {end_of(joint, "child"): joint for joint in self.joints.values()}
        self.root = next(name for name in self.links if name not in self.joint_of_child)
        self.moving_joints = {name: joint for name, joint in self.joints.items() if self._moves(joint)}

    def parent(self, link: str) -> str:
        """Return the name of a link's parent, '' for the root."""
        joint = self.joint_of_child.get(link)
        return "" if joint is None else end_of(joint, "parent")

    def moving(self, joint: ElementTree.Element) -> bool:
        """Whether a joint moves."""
        return joint.get("name", "") in self.moving_joints

    def _moves(self, joint: ElementTree.Element) -> bool:
        kind, name = joint.get("type"), joint.get("name")
        if kind not in ("fixed", "revolute", SLIDING):
            self.mistakes.append(
                f"the joint {name!r} of {self.file.name} is {kind}; make it revolute or prismatic, with limits, or "
                "fixed"
            )
        return kind != "fixed"

    def slides(self, joint: ElementTree.Element) -> bool:
        """Whether a joint slides along its axis instead of turning about it."""
        return joint.get("type") == SLIDING

    def follower(self, joint: ElementTree.Element) -> Follower | None:
        """Return how a joint follows an independent one, through others in between; None where it moves by itself."""
        found: Follower | None = None
        seen = [joint.get("name", "")]
        while (mimic := joint.find("mimic")) is not None:
            name = mimic.get("joint", "")
            if name not in self.moving_joints or name in seen:
                what = "itself" if name in seen else f"{name!r}, which does not move"
                self.mistakes.append(f"the joint {seen[0]!r} of {self.file.name} follows {what}; mend its mimic there")
                return Follower(name, 1.0, 0.0)
            multiplier, offset = float(mimic.get("multiplier", "1")), float(mimic.get("offset", "0"))
            gain = 1.0 if found is None else found.multiplier
            found = Follower(name, gain * multiplier, gain * offset + (0.0 if found is None else found.offset))
            seen.append(name)
            joint = self.joints[name]
        return found

    def limits(self, joint: ElementTree.Element) -> tuple[float, float]:
        """Return lower and upper limit, rad, or m of a joint that slides."""
        limit = joint.find("limit")
        lower, upper = (None if limit is None else limit.get(end) for end in ("lower", "upper"))
        if lower is None or upper is None or not float(lower) < float(upper):
            self.mistakes.append(
                f"the joint {joint.get('name')!r} of {self.file.name} needs limits, lower < upper; add them there"
            )
            return -np.pi, np.pi
        return float(lower), float(upper)

    def effort(self, joint: ElementTree.Element) -> float | None:
        """Return the largest torque, N m, or force, N, of a joint; None where the URDF has none or says 0."""
        limit = joint.find("limit")
        return None if limit is None else float(limit.get("effort", "0")) or None

    def has_shape(self, link: str) -> bool:
        """Whether a link collides."""
        return self.links[link].find("collision") is not None

    def boxes_and_balls(
        self, link: str
    ) -> tuple[
        list[tuple[NDArray[np.float64], NDArray[np.float64]]], list[tuple[NDArray[np.float64], float]], list[int]
    ]:
        """Return boxes (pose (4, 4), half extents (3,)) and balls (centre (3,), radius) of a link, link frame.

        The third list numbers the collision shapes that are neither: meshes, cylinders, boxes turned in that frame.
        """
        boxes, balls, others = [], [], []
        for index, collision in enumerate(self.links[link].iter("collision")):
            pose = origin_matrix(collision.find("origin"))
            box, ball = collision.find("geometry/box"), collision.find("geometry/sphere")
            if box is not None and np.allclose(pose[:3, :3], np.eye(3), rtol=0, atol=UNTURNED):
                boxes.append((pose, vector(box.get("size")) / 2))
            elif ball is not None:
                balls.append((pose[:3, 3], float(ball.get("radius", ""))))
            else:
                others.append(index)
        return boxes, balls, others
