"""A hand as arrays: links, joints, limits, collision shapes, fingers and contact candidates.

Made of a hand's description (``records.parameters.hand``) and of the URDF that physics loads, so that synthesis and
simulation cannot disagree on joints and limits. Nothing here is about one hand.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.contacts import contact_candidates
from pipeline.hand.joints import PhysicalJoints, joint_limits, physical_joints
from pipeline.hand.mount import Mount
from pipeline.hand.shapes import LinkShapes, ShapeFit, link_shapes
from pipeline.hand.standard import source_file, standard_urdf
from pipeline.hand.urdf import Follower, Urdf, end_of, origin_matrix, vector
from pipeline.records.errors import UserError, one_sentence
from pipeline.records.hands import description_file
from pipeline.records.parameters.hand import (
    FLANGE_LINK,
    MOUNT_LINK,
    PALM,
    HandDescription,
    HandStyle,
    HoldingDescription,
    read_description,
)


@dataclass(frozen=True, eq=False)
class Hand:
    """A hand's geometry; ``L`` links in ``link_names`` order, ``J`` joints in ``joint_names`` order, SI units.

    The ``J`` joints are those that move by themselves; positions of joints that slide are in m, of others in rad.
    A hand is the same object wherever its file is loaded in a process, and travels between processes as its file.
    """

    name: str
    source: Path  # its description
    urdf: Path  # or MJCF, as it was found
    standard_urdf: str = field(repr=False)  # what loaders take, see ``hand.standard``
    link_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    parent: NDArray[np.int64]  # (L,) parent link, -1 for the root; a parent comes before its children
    joint: NDArray[np.int64]  # (L,) joint that moves the link, -1 where it is fixed to its parent
    multiplier: NDArray[np.float64]  # (L,) the link moves by this times the joint's position,
    offset: NDArray[np.float64]  # (L,) plus this, rad or m; 1 and 0 but for links of coupled joints
    slides: NDArray[np.bool_]  # (L,) along the axis; others turn
    follows: NDArray[np.bool_]  # (L,) whether the joint is moved through a coupling
    origin: NDArray[np.float64]  # (L, 4, 4) T_parent_link where the link has not moved
    axis: NDArray[np.float64]  # (L, 3) joint axis in the link frame, 0 where fixed
    lower: NDArray[np.float64]  # (J,) also such that no joint that follows exceeds its limits
    upper: NDArray[np.float64]  # (J,)
    physical: PhysicalJoints
    box_link: NDArray[np.int64]  # (B,)
    box_pose: NDArray[np.float64]  # (B, 4, 4) T_link_box; never turned
    box_half: NDArray[np.float64]  # (B, 3) half extents
    sphere_link: NDArray[np.int64]  # (S,)
    sphere_centre: NDArray[np.float64]  # (S, 3) link frame
    sphere_radius: NDArray[np.float64]  # (S,)
    shape_fits: Mapping[str, ShapeFit]  # by link, where boxes and balls stand for other shapes
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
    start: NDArray[np.float64]  # (J,) rad, in which trials begin
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
    source = source_file(description.urdf, file.parent)
    robot = standard_urdf(source, description.urdf.root, description.density)
    urdf = Urdf(robot, source)
    _check_names(description, urdf)
    physical, followers = physical_joints(description, urdf)
    lower, upper = joint_limits(physical, len(description.joints), urdf)
    if urdf.mistakes:
        raise UserError(one_sentence(file, urdf.mistakes))
    names = _ordered_links(description, urdf)
    tree = [_step(name, names, description, urdf, followers) for name in names]
    shapes = link_shapes(names, description, urdf)
    fingers = description.fingers
    finger_of_link = {link: finger for finger, own in fingers.items() for link in own.links}
    links, points, normals = contact_candidates(description, names, shapes.boxes, shapes.spheres, file)
    return Hand(
        name=file.parent.name,
        source=file,
        urdf=source,
        standard_urdf=ElementTree.tostring(robot, encoding="unicode"),
        link_names=tuple(names),
        joint_names=tuple(description.joints),
        parent=np.array([step.parent for step in tree]),
        joint=np.array([step.joint for step in tree]),
        multiplier=np.array([step.multiplier for step in tree]),
        offset=np.array([step.offset for step in tree]),
        slides=np.array([step.slides for step in tree]),
        follows=np.array([step.follows for step in tree]),
        origin=np.array([step.origin for step in tree]),
        axis=np.array([step.axis for step in tree]),
        lower=lower,
        upper=upper,
        physical=physical,
        **_shape_arrays(shapes),
        contact_link=np.array(links, dtype=np.int64),
        contact_points=np.array(points, dtype=np.float64).reshape(-1, 3),
        contact_normals=np.array(normals, dtype=np.float64).reshape(-1, 3),
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
        start=np.array(description.start or next(iter(description.styles.values())).posture, dtype=np.float64),
        styles={str(name): style for name, style in description.styles.items()},
    )


@dataclass(frozen=True)
class _Step:
    """How one link hangs on its parent; see the fields of :class:`Hand`."""

    parent: int
    joint: int
    multiplier: float
    offset: float
    slides: bool
    follows: bool
    origin: NDArray[np.float64]
    axis: NDArray[np.float64]


def _step(
    name: str, names: Sequence[str], description: HandDescription, urdf: Urdf, followers: Mapping[str, Follower]
) -> _Step:
    element = urdf.joint_of_child.get(name) if name != urdf.root else None
    if element is None:
        return _Step(-1, -1, 1.0, 0.0, False, False, np.eye(4), np.zeros(3))
    parent, origin = names.index(urdf.parent(name)), origin_matrix(element.find("origin"))
    if not urdf.moving(element):
        return _Step(parent, -1, 1.0, 0.0, False, False, origin, np.zeros(3))
    own = element.get("name", "")
    coupling = followers.get(own, Follower(own, 1.0, 0.0))
    joint = description.joints.index(coupling.joint)
    moves = (coupling.multiplier, coupling.offset, urdf.slides(element), own in followers)
    return _Step(parent, joint, *moves, origin, _unit_axis(element))


def _shape_arrays(shapes: LinkShapes) -> dict[str, Any]:
    boxes, spheres = shapes.boxes, shapes.spheres
    return {
        "box_link": np.array([link for link, _, _ in boxes], dtype=np.int64),
        "box_pose": np.array([pose for _, pose, _ in boxes]).reshape(-1, 4, 4),
        "box_half": np.array([half for _, _, half in boxes]).reshape(-1, 3),
        "sphere_link": np.array([link for link, _, _ in spheres], dtype=np.int64),
        "sphere_centre": np.array([centre for _, centre, _ in spheres]).reshape(-1, 3),
        "sphere_radius": np.array([radius for _, _, radius in spheres], dtype=np.float64),
        "shape_fits": shapes.fits,
    }


def _unit_axis(joint: ElementTree.Element) -> NDArray[np.float64]:
    element = joint.find("axis")
    axis = vector("1 0 0" if element is None else element.get("xyz"))
    length = np.linalg.norm(axis)
    return axis if length == 1.0 else axis / length


def _check_names(description: HandDescription, urdf: Urdf) -> None:
    """Check that every link of the description is in the URDF, and in its place."""
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
                urdf.mistakes.append(f"{where} names the link {name!r}, which {urdf.file.name} does not have")
    owned = [link for finger in description.fingers.values() for link in finger.links]
    for name in sorted({name for name in owned if owned.count(name) > 1}):
        urdf.mistakes.append(f"the link {name!r} is in two fingers; give it to one")
    for finger, own in description.fingers.items():
        if finger != PALM and not own.joints and not any(_is_moved(link, urdf) for link in own.links):
            urdf.mistakes.append(f"fingers.{finger}: no joint moves it; name its joints, or call it {PALM!r}")
    for name in description.contacts:
        if name in urdf.links and name not in owned:
            urdf.mistakes.append(f"contacts names the link {name!r}, which is in no finger; add it to one")


def _is_moved(link: str, urdf: Urdf) -> bool:
    while link in urdf.joint_of_child:
        if urdf.moving(urdf.joint_of_child[link]):
            return True
        link = urdf.parent(link)
    return False


def _ordered_links(description: HandDescription, urdf: Urdf) -> list[str]:
    """Return the root, all links that move or have shapes, and those between, from the root outwards, by finger."""
    wanted = {urdf.root}
    moved = {end_of(joint, "child") for joint in urdf.moving_joints.values()}
    for name in urdf.links:
        if name in moved or urdf.has_shape(name) or name in description.shapes:
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
