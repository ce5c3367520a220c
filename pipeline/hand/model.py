"""A hand as arrays: links, joints, limits, collision shapes, fingers and contact candidates.

Made of a hand's description (``records.parameters.hand``) and of the URDF that physics loads, so that synthesis and
simulation cannot disagree on joints and limits. Nothing here is about one hand.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.contacts import contact_candidates
from pipeline.hand.mount import Mount
from pipeline.hand.urdf import Urdf, origin_matrix, vector
from pipeline.records.errors import UserError
from pipeline.records.hands import description_file
from pipeline.records.parameters.hand import (
    FLANGE_LINK,
    MOUNT_LINK,
    HandDescription,
    HandStyle,
    HoldingDescription,
    ShapesDescription,
    UrdfSource,
    read_description,
)

MOST_SHAPES = 62  # bits of the kernel's mask


@dataclass(frozen=True, eq=False)
class Hand:
    """A hand's geometry; ``L`` links in ``link_names`` order, ``J`` joints in ``joint_names`` order, SI units.

    A hand is the same object wherever its file is loaded in a process, and travels between processes as its file.
    """

    name: str
    source: Path  # its description
    urdf: Path
    link_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    parent: NDArray[np.int64]  # (L,) parent link, -1 for the root; a parent comes before its children
    joint: NDArray[np.int64]  # (L,) joint that moves the link, -1 where it is fixed to its parent
    origin: NDArray[np.float64]  # (L, 4, 4) T_parent_link at joint angle 0
    axis: NDArray[np.float64]  # (L, 3) joint axis in the link frame, 0 where fixed
    lower: NDArray[np.float64]  # (J,) rad
    upper: NDArray[np.float64]  # (J,) rad
    box_link: NDArray[np.int64]  # (B,)
    box_pose: NDArray[np.float64]  # (B, 4, 4) T_link_box; never turned
    box_half: NDArray[np.float64]  # (B, 3) half extents
    sphere_link: NDArray[np.int64]  # (S,)
    sphere_centre: NDArray[np.float64]  # (S, 3) link frame
    sphere_radius: NDArray[np.float64]  # (S,)
    contact_link: NDArray[np.int64]  # (C,)
    contact_points: NDArray[np.float64]  # (C, 3) link frame, on the collision surface
    contact_normals: NDArray[np.float64]  # (C, 3) link frame, outward from the hand
    contact_finger: tuple[str, ...]  # (C,)
    finger_joints: Mapping[str, tuple[int, ...]]  # joints of each finger; the palm has none
    finger_links: Mapping[str, tuple[str, ...]]  # links of each finger that hold objects
    finger_base: Mapping[str, str | None]  # the link before them
    straight: Mapping[str, tuple[float, ...]]  # rad, joints of the fingers that have a straight posture
    holding: Mapping[str, HoldingDescription]  # of the fingers whose room other grasps can leave free
    opposing: tuple[str, ...]  # fingers that the others press against
    palm_normal: NDArray[np.float64]  # (3,) unit, hand frame
    tips: frozenset[str]  # links with the friction of fingertips
    may_overlap: tuple[tuple[str, str], ...]
    never_meeting: tuple[tuple[str, ...], ...]
    mount: Mount | None  # between it and the flange of the Panda; None: nothing is modelled behind it
    styles: Mapping[str, HandStyle] = field(repr=False)

    def __reduce__(self) -> tuple[Callable[[Path], Hand], tuple[Path]]:
        return hand_of_file, (self.source,)

    @property
    def joint_count(self) -> int:
        """J."""
        return len(self.joint_names)

    @property
    def root(self) -> str:
        """Link whose frame is the hand's."""
        return self.link_names[0]

    def link(self, name: str) -> int:
        """Index of a link."""
        return self.link_names.index(name)

    def style(self, name: str) -> HandStyle:
        """Return how the hand begins to look for a grasp of a style.

        Raises:
            UserError: it has no such style.
        """
        if name not in self.styles:
            raise UserError(
                f"the hand {self.name} has no style {name!r}; use {' or '.join(self.styles)}, or describe it under "
                f"`styles` of {self.source}."
            )
        return self.styles[name]


def load_hand(name: str) -> Hand:
    """Read the hand that ``hands/<name>`` describes.

    Raises:
        UserError: there is none, or its description is wrong or does not fit its URDF.
    """
    return hand_of_file(description_file(name))


@lru_cache(maxsize=8)
def hand_of_file(file: Path) -> Hand:
    """Read the hand that a file describes; see :func:`load_hand`."""
    description = read_description(file)
    try:
        return _hand(file, description)
    except ValueError as error:
        raise UserError(f"{file}: the URDF has a value that is no number ({error}); mend it there.") from error


def _hand(file: Path, description: HandDescription) -> Hand:
    urdf = Urdf(urdf_file(description.urdf, file.parent))
    _check_names(description, urdf, file)
    names = _ordered_links(description, urdf)
    parent, joint, origin, axis = [], [], [], []
    lower, upper = np.zeros(len(description.joints)), np.zeros(len(description.joints))
    for name in names:
        element = urdf.joint_of_child.get(name)
        parent.append(-1 if element is None else names.index(urdf.parent(name)))
        origin.append(np.eye(4) if element is None else _origin(element))
        moves = element is not None and urdf.moving(element)
        joint.append(description.joints.index(element.get("name", "")) if element is not None and moves else -1)
        axis.append(_unit_axis(element) if element is not None and moves else np.zeros(3))
        if element is not None and moves:
            lower[joint[-1]], upper[joint[-1]] = urdf.limits(element)
    boxes, spheres = _all_shapes(names, description, urdf, file)
    fingers = description.fingers
    finger_of_link = {link: finger for finger, own in fingers.items() for link in own.links}
    links, points, normals = contact_candidates(description, names, boxes, spheres, file)
    return Hand(
        name=file.parent.name,
        source=file,
        urdf=urdf.file,
        link_names=tuple(names),
        joint_names=tuple(description.joints),
        parent=np.array(parent),
        joint=np.array(joint),
        origin=np.array(origin),
        axis=np.array(axis),
        lower=lower,
        upper=upper,
        box_link=np.array([link for link, _, _ in boxes], dtype=np.int64),
        box_pose=np.array([pose for _, pose, _ in boxes]).reshape(-1, 4, 4),
        box_half=np.array([half for _, _, half in boxes]).reshape(-1, 3),
        sphere_link=np.array([link for link, _, _ in spheres], dtype=np.int64),
        sphere_centre=np.array([centre for _, centre, _ in spheres]).reshape(-1, 3),
        sphere_radius=np.array([radius for _, _, radius in spheres], dtype=np.float64),
        contact_link=np.array(links),
        contact_points=np.array(points),
        contact_normals=np.array(normals, dtype=np.float64),
        contact_finger=tuple(finger_of_link[names[link]] for link in links),
        finger_joints={name: tuple(map(description.joints.index, own.joints)) for name, own in fingers.items()},
        finger_links={name: tuple(own.links) for name, own in fingers.items()},
        finger_base={name: own.base for name, own in fingers.items()},
        straight={name: tuple(own.straight) for name, own in fingers.items() if own.straight is not None},
        holding={name: own.holding for name, own in fingers.items() if own.holding is not None},
        opposing=tuple(description.opposing),
        palm_normal=np.array(description.palm_normal) / np.linalg.norm(description.palm_normal),
        tips=frozenset(description.tips),
        may_overlap=tuple(description.may_overlap),
        never_meeting=tuple(tuple(group) for group in description.never_meeting),
        mount=None if description.mount is None else Mount(description.mount),
        styles={str(name): style for name, style in description.styles.items()},
    )


def urdf_file(source: UrdfSource, folder: Path) -> Path:
    """Return the path of a URDF; packages are found without importing them.

    Args:
        folder: of the hand's description.

    Raises:
        UserError: the package is not installed, or there is no such file.
    """
    if source.package is None:
        file = folder / source.path
    else:
        spec = find_spec(source.package)
        if spec is None or not spec.submodule_search_locations:
            raise UserError(
                f"the package {source.package} is not installed; run `./dev doctor` to set the environment up."
            )
        file = Path(spec.submodule_search_locations[0]) / source.path
    if not file.is_file():
        raise UserError(f"{folder / 'hand.yaml'}: there is no URDF {file}; correct `urdf` there.")
    return file


def _origin(joint: object) -> NDArray[np.float64]:
    return origin_matrix(joint.find("origin"))  # type: ignore[attr-defined]


def _unit_axis(joint: object) -> NDArray[np.float64]:
    element = joint.find("axis")  # type: ignore[attr-defined]
    axis = vector("1 0 0" if element is None else element.get("xyz"))
    length = np.linalg.norm(axis)
    return axis if length == 1.0 else axis / length


def _check_names(description: HandDescription, urdf: Urdf, file: Path) -> None:
    """Check that every link and joint of the description is in the URDF, and every moving joint in the description."""
    for name in description.joints:
        if name not in urdf.joints:
            raise UserError(f"{file}: joints names {name!r}, which the URDF {urdf.file.name} does not have.")
        if not urdf.moving(urdf.joints[name]):
            raise UserError(f"{file}: joints names {name!r}, which does not move in {urdf.file.name}; remove it.")
    for name, joint in urdf.joints.items():
        if urdf.moving(joint) and name not in description.joints:
            raise UserError(f"{file}: the joint {name!r} of {urdf.file.name} moves; add it to joints and to a finger.")
    behind = (FLANGE_LINK, MOUNT_LINK) if description.mount is not None else ()
    named = {
        "tips": description.tips,
        "shapes": description.shapes,
        "contacts": description.contacts,
        "may_overlap": [link for pair in description.may_overlap for link in pair],
        "never_meeting": [link for group in description.never_meeting for link in group if link not in behind],
    }
    for finger, own in description.fingers.items():
        named[f"fingers.{finger}"] = [*own.links, *([own.base] if own.base else [])]
    for where, names in named.items():
        for name in names:
            if name not in urdf.links:
                raise UserError(f"{file}: {where} names the link {name!r}, which {urdf.file.name} does not have.")
    owned = [link for finger in description.fingers.values() for link in finger.links]
    for name in owned:
        if owned.count(name) > 1:
            raise UserError(f"{file}: the link {name!r} is in two fingers; give it to one.")
    for name in description.contacts:
        if name not in owned:
            raise UserError(f"{file}: contacts names the link {name!r}, which is in no finger; add it to one.")


def _ordered_links(description: HandDescription, urdf: Urdf) -> list[str]:
    """Return the root and all links with shapes, and those between, from the root outwards, finger by finger."""
    wanted = {urdf.root}
    for name in urdf.links:
        if urdf.has_shape(name) or name in description.shapes:
            while name and name not in wanted:
                wanted.add(name)
                name = urdf.parent(name)
    names: list[str] = []

    def visit(name: str) -> None:
        names.append(name)
        children = [child for child in urdf.links if child in wanted and urdf.parent(child) == name]
        ranks = {joint: rank for rank, joint in enumerate(description.joints)}
        children.sort(key=lambda child: ranks.get(urdf.joint_of_child[child].get("name", ""), -1))
        for child in children:
            visit(child)

    visit(urdf.root)
    return names


def _all_shapes(
    names: Sequence[str], description: HandDescription, urdf: Urdf, file: Path
) -> tuple[list[tuple[int, NDArray[np.float64], NDArray[np.float64]]], list[tuple[int, NDArray[np.float64], float]]]:
    """Return the boxes (link, pose, half extents) and balls (link, centre, radius) of all links, in their order."""
    boxes: list[tuple[int, NDArray[np.float64], NDArray[np.float64]]] = []
    spheres: list[tuple[int, NDArray[np.float64], float]] = []
    for index, name in enumerate(names):
        own_boxes, own_balls = _shapes(name, description.shapes.get(name), urdf, file)
        boxes += [(index, pose, half) for pose, half in own_boxes]
        spheres += [(index, centre, radius) for centre, radius in own_balls]
    if len(boxes) + len(spheres) > MOST_SHAPES:
        raise UserError(
            f"{file}: the hand has {len(boxes) + len(spheres)} boxes and balls, {MOST_SHAPES} are possible; describe "
            "links by fewer under `shapes`."
        )
    return boxes, spheres


def _shapes(
    name: str, replaced: ShapesDescription | None, urdf: Urdf, file: Path
) -> tuple[list[tuple[NDArray[np.float64], NDArray[np.float64]]], list[tuple[NDArray[np.float64], float]]]:
    if replaced is None:
        return urdf.boxes_and_balls(name, file)
    boxes = []
    for box in replaced.boxes:
        pose = np.eye(4)
        pose[:3, 3] = box.centre
        boxes.append((pose, np.array(box.size) / 2))
    return boxes, [(np.array(ball.centre), ball.radius) for ball in replaced.spheres]
