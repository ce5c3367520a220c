"""What is read from a URDF: transforms, the tree of links, joint limits, collision boxes and balls."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.records.errors import UserError

UNTURNED = 1e-9  # how far a box's rotation may be from none


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


class Urdf:
    """The elements of a URDF by name.

    Raises:
        UserError: the file is missing or is not a URDF.
    """

    def __init__(self, file: Path) -> None:
        try:
            root = ElementTree.parse(file).getroot()
        except OSError as error:
            raise UserError(f"{file} cannot be read ({error.strerror}); correct `urdf` of the hand there.") from error
        except ElementTree.ParseError as error:
            raise UserError(f"{file} is not XML ({error}); mend the URDF.") from error
        self.file = file
        self.links = {link.get("name", ""): link for link in root.findall("link")}
        self.joints = {joint.get("name", ""): joint for joint in root.findall("joint")}
        self.joint_of_child = {self._end(joint, "child"): joint for joint in self.joints.values()}
        roots = [name for name in self.links if name not in self.joint_of_child]
        if len(roots) != 1:
            raise UserError(f"{file} has {len(roots)} root links; a hand has one tree of links.")
        self.root = roots[0]

    def _end(self, joint: ElementTree.Element, end: str) -> str:
        element = joint.find(end)
        name = "" if element is None else element.get("link", "")
        if name not in self.links:
            raise UserError(f"{self.file}: the joint {joint.get('name')!r} has no {end} link; mend the URDF.")
        return name

    def parent(self, link: str) -> str:
        """Return the name of a link's parent, '' for the root."""
        joint = self.joint_of_child.get(link)
        return "" if joint is None else self._end(joint, "parent")

    def moving(self, joint: ElementTree.Element) -> bool:
        """Whether a joint moves.

        Raises:
            UserError: it moves in a way that is not supported.
        """
        kind, name = joint.get("type"), joint.get("name")
        if kind == "fixed":
            return False
        if joint.find("mimic") is not None:
            raise UserError(
                f"{self.file}: the joint {name!r} mimics another one, which is not supported; fix it or use a hand "
                "whose joints move by themselves."
            )
        if kind != "revolute":
            raise UserError(f"{self.file}: the joint {name!r} is {kind}; only revolute and fixed ones are supported.")
        return True

    def limits(self, joint: ElementTree.Element) -> tuple[float, float]:
        """Return lower and upper limit, rad."""
        limit = joint.find("limit")
        lower, upper = (None if limit is None else limit.get(end) for end in ("lower", "upper"))
        if lower is None or upper is None or not float(lower) < float(upper):
            raise UserError(
                f"{self.file}: the joint {joint.get('name')!r} needs limits, lower < upper; add them there."
            )
        return float(lower), float(upper)

    def has_shape(self, link: str) -> bool:
        """Whether a link collides."""
        return self.links[link].find("collision") is not None

    def boxes_and_balls(
        self, link: str, description: Path
    ) -> tuple[list[tuple[NDArray[np.float64], NDArray[np.float64]]], list[tuple[NDArray[np.float64], float]]]:
        """Return boxes (pose (4, 4), half extents (3,)) and balls (centre (3,), radius) of a link, link frame.

        Raises:
            UserError: the link has another shape; ``description`` is where to describe it.
        """
        boxes, balls = [], []
        for collision in self.links[link].iter("collision"):
            pose = origin_matrix(collision.find("origin"))
            box, ball = collision.find("geometry/box"), collision.find("geometry/sphere")
            if box is not None and np.allclose(pose[:3, :3], np.eye(3), rtol=0, atol=UNTURNED):
                boxes.append((pose, vector(box.get("size")) / 2))
            elif ball is not None:
                balls.append((pose[:3, 3], float(ball.get("radius", ""))))
            else:
                geometry = collision.find("geometry")
                kind = "no geometry" if geometry is None or len(geometry) == 0 else f"a {geometry[0].tag}"
                kind += " that is turned in the link's frame" if box is not None else ""
                raise UserError(
                    f"{description}: the link {link!r} has {kind} for a collision shape; describe the link by boxes "
                    "and spheres under `shapes`."
                )
        return boxes, balls
