"""The Allegro hand as arrays: links, joints, limits, collision shapes, fingers and contact candidates.

Joints, limits and boxes are read from the URDF that physics loads, so that synthesis and simulation cannot disagree.
The fingertip's collision mesh (24.0 x 24.0 x 23.0 mm) is represented by the ball of 12 mm that it was cut from.
Contact candidates follow the released grids (notes of the paper's contact JSON: 143 points), each projected onto the
collision surface used here, because the released points partly lie on shapes that physics does not have.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.assets import allegro_description

TIP_RADIUS = 0.012  # m
JOINT_NAMES = tuple(f"joint_{index}.0" for index in range(16))
FINGER_JOINTS: dict[str, tuple[int, ...]] = {
    "index": (0, 1, 2, 3),
    "middle": (4, 5, 6, 7),
    "ring": (8, 9, 10, 11),
    "thumb": (12, 13, 14, 15),
    "palm": (),
}
FINGER_LINKS: dict[str, tuple[str, ...]] = {
    "index": ("link_1.0", "link_2.0", "link_3.0", "link_3.0_tip"),
    "middle": ("link_5.0", "link_6.0", "link_7.0", "link_7.0_tip"),
    "ring": ("link_9.0", "link_10.0", "link_11.0", "link_11.0_tip"),
    "thumb": ("link_13.0", "link_14.0", "link_15.0", "link_15.0_tip"),
    "palm": ("base_link",),
}


@dataclass(frozen=True)
class Hand:
    """The hand's geometry; ``L`` links in ``link_names`` order, 16 joints in ``JOINT_NAMES`` order, SI units."""

    link_names: tuple[str, ...]
    parent: NDArray[np.int64]  # (L,) parent link, -1 for base_link; a parent comes before its children
    joint: NDArray[np.int64]  # (L,) joint that moves the link, -1 where it is fixed to its parent
    origin: NDArray[np.float64]  # (L, 4, 4) T_parent_link at joint angle 0
    axis: NDArray[np.float64]  # (L, 3) joint axis in the link frame, 0 where fixed
    lower: NDArray[np.float64]  # (16,) rad
    upper: NDArray[np.float64]  # (16,) rad
    box_link: NDArray[np.int64]  # (B,)
    box_pose: NDArray[np.float64]  # (B, 4, 4) T_link_box
    box_half: NDArray[np.float64]  # (B, 3) half extents
    sphere_link: NDArray[np.int64]  # (S,) fingertips
    sphere_centre: NDArray[np.float64]  # (S, 3) link frame
    sphere_radius: NDArray[np.float64]  # (S,)
    contact_link: NDArray[np.int64]  # (C,)
    contact_points: NDArray[np.float64]  # (C, 3) link frame, on the collision surface
    contact_normals: NDArray[np.float64]  # (C, 3) link frame, outward from the hand
    contact_finger: tuple[str, ...]  # (C,)

    def link(self, name: str) -> int:
        """Index of a link."""
        return self.link_names.index(name)


def _vector(text: str | None) -> NDArray[np.float64]:
    return np.array([float(part) for part in (text or "0 0 0").split()])


def origin_matrix(element: ElementTree.Element | None) -> NDArray[np.float64]:
    """Return the 4x4 of a URDF ``<origin>``; rpy is extrinsic xyz (R = Rz Ry Rx)."""
    T = np.eye(4)
    if element is None:
        return T
    (sr, sp, sy), (cr, cp, cy) = (f(_vector(element.get("rpy"))) for f in (np.sin, np.cos))
    T[:3, :3] = (
        np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
        @ np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
        @ np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    )
    T[:3, 3] = _vector(element.get("xyz"))
    return T


def _tip_grid() -> NDArray[np.float64]:
    """Fifteen points on the fingertip ball: 6, 5, 4 azimuths within 54 degrees of +x, at three heights."""
    cosines = np.linspace(np.cos(0.45 * np.pi), np.cos(0.15 * np.pi), 3)
    points = []
    for cosine, count in zip(cosines, (6, 5, 4), strict=True):
        sine = np.sqrt(1 - cosine**2)
        for azimuth in np.linspace(-0.3 * np.pi, 0.3 * np.pi, count):
            points.append([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine])
    return TIP_RADIUS * np.array(points)


def _grid(x: float, ys: list[float], zs: list[float]) -> list[list[float]]:
    return [[x, y, z] for y in ys for z in zs]


def _released_candidates() -> dict[str, NDArray[np.float64]]:
    """The released candidate grids per link, link frame, m."""
    x, side = 0.0098, [-0.0045833, 0.0045833]
    palm = _grid(0.0111, list(np.linspace(-0.04, 0.04, 4)), [-0.015, -0.035]) + _grid(
        0.0111, [-0.04, -0.01], [-0.055, -0.075]
    )
    grids: dict[str, list[list[float]]] = {"base_link": palm}
    for proximal in (1, 5, 9):
        grids[f"link_{proximal}.0"] = _grid(x, side, [0.0108, 0.0216, 0.0324, 0.0432])
        grids[f"link_{proximal + 1}.0"] = _grid(x, side, [0.0096, 0.0192, 0.0288])
        grids[f"link_{proximal + 2}.0"] = [[x, 0.0, 0.01335], *_grid(x, side, [0.0089, 0.0178])]
    grids["link_14.0"] = _grid(x, side, [0.01028, 0.02056, 0.03084, 0.04112])
    grids["link_15.0"] = _grid(x, side, [0.010575, 0.02115, 0.031725])
    return {link: np.array(points) for link, points in grids.items()}


@lru_cache(maxsize=1)
def load_hand() -> Hand:
    """Read the right Allegro hand from mani_skill's URDF.

    Links without collision shape (palm and wrist frames) are left out.

    Raises:
        UserError: mani_skill is not installed.
    """
    root = ElementTree.parse(allegro_description()).getroot()
    joint_of_child = {joint.find("child").get("link"): joint for joint in root.iter("joint")}  # type: ignore[union-attr]
    elements = {link.get("name", ""): link for link in root.iter("link")}
    names = [name for name, link in elements.items() if link.find("collision") is not None]
    names.sort(
        key=lambda name: (name != "base_link", float(name.split("_")[1]) if name != "base_link" else 0, len(name))
    )
    parent, joint, origin, axis = [], [], [], []
    lower, upper = np.zeros(16), np.zeros(16)
    for name in names:
        element = joint_of_child.get(name)
        if element is None:
            parent.append(-1)
            joint.append(-1)
            origin.append(np.eye(4))
            axis.append(np.zeros(3))
            continue
        parent.append(names.index(element.find("parent").get("link")))  # type: ignore[union-attr, arg-type]
        origin.append(origin_matrix(element.find("origin")))
        if element.get("type") == "fixed":
            joint.append(-1)
            axis.append(np.zeros(3))
            continue
        index = JOINT_NAMES.index(element.get("name", ""))
        limit = element.find("limit")
        lower[index], upper[index] = float(limit.get("lower")), float(limit.get("upper"))  # type: ignore[union-attr, arg-type]
        joint.append(index)
        axis.append(_vector(element.find("axis").get("xyz")))  # type: ignore[union-attr]
    boxes: list[tuple[int, NDArray[np.float64], NDArray[np.float64]]] = []
    spheres: list[int] = []
    for index, name in enumerate(names):
        for collision in elements[name].iter("collision"):
            box = collision.find("geometry/box")
            if box is None:
                spheres.append(index)
            else:
                boxes.append((index, origin_matrix(collision.find("origin")), _vector(box.get("size")) / 2))
    links, points, normals = [], [], []
    for name, released in _released_candidates().items():
        own = [(pose, half) for link, pose, half in boxes if names[link] == name]
        for point in released:
            links.append(names.index(name))
            points.append(_project_forward(point, own))
            normals.append([1.0, 0.0, 0.0])
    for index in spheres:
        grid = _tip_grid()
        links += [index] * len(grid)
        points += list(grid)
        normals += list(grid / TIP_RADIUS)
    finger_of_link = {link: finger for finger, finger_links in FINGER_LINKS.items() for link in finger_links}
    return Hand(
        link_names=tuple(names),
        parent=np.array(parent),
        joint=np.array(joint),
        origin=np.array(origin),
        axis=np.array(axis),
        lower=lower,
        upper=upper,
        box_link=np.array([link for link, _, _ in boxes]),
        box_pose=np.array([pose for _, pose, _ in boxes]),
        box_half=np.array([half for _, _, half in boxes]),
        sphere_link=np.array(spheres),
        sphere_centre=np.zeros((len(spheres), 3)),
        sphere_radius=np.full(len(spheres), TIP_RADIUS),
        contact_link=np.array(links),
        contact_points=np.array(points),
        contact_normals=np.array(normals, dtype=np.float64),
        contact_finger=tuple(finger_of_link[names[link]] for link in links),
    )


def _project_forward(
    point: NDArray[np.float64], boxes: list[tuple[NDArray[np.float64], NDArray[np.float64]]]
) -> NDArray[np.float64]:
    """Move a released candidate to the nearest point on the +x faces of a link's boxes (box frames are unrotated)."""
    best, best_distance = point, np.inf
    for pose, half in boxes:
        centre = pose[:3, 3]
        face = np.clip(point, centre - half, centre + half)
        face[0] = centre[0] + half[0]
        distance = float(np.linalg.norm(face - point))
        if distance < best_distance:
            best, best_distance = face, distance
    return best
