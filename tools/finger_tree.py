"""The fingers of a hand, told from its tree of links alone."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from pipeline.hand.urdf import Urdf, end_of
from pipeline.records.parameters.hand import PALM


@dataclass(frozen=True)
class FingerTree:
    """What the tree says about fingers; names are those of links and joints."""

    root: str  # link from which the fingers spread; an arm or a wrist before it is left out
    joints: list[str]  # that move by themselves, finger by finger
    fingers: dict[str, tuple[list[str], list[str]]]  # links with shapes or joints, and joints, from base to tip
    palm: list[str]  # links that do not move


def spreading_link(urdf: Urdf) -> str:
    """Return the link from which several chains of moving links spread: the one that is the palm, or carries it.

    Links with shapes that do not move belong to the hand, but for the last one of an arm.
    """
    link, may_leave = urdf.root, False
    while True:
        below = _moving_below(link, urdf)
        if len(below) == 1 and len(list(_ends(end_of(below[0], "child"), urdf))) > 1:
            link, may_leave = end_of(below[0], "child"), True
            continue
        onward = [child for child in _children(link, urdf) if _carries_all(child, below, urdf)]
        if not onward or (urdf.has_shape(link) and not may_leave):
            return link
        may_leave = may_leave and not urdf.has_shape(link)
        link = onward[0]


def finger_tree(urdf: Urdf) -> FingerTree:
    """Return the fingers below the root of a URDF: one per end of a chain of moving links.

    Links and joints that several chains share belong to the first of them.
    """
    moved = {end_of(joint, "child") for joint in urdf.moving_joints.values()}
    fingers: dict[str, tuple[list[str], list[str]]] = {}
    joints: list[str] = []
    taken: set[str] = set()
    for end in [one for joint in _moving_below(urdf.root, urdf) for one in _ends(end_of(joint, "child"), urdf)]:
        path = [end]
        while urdf.parent(path[0]) and path[0] != urdf.root:
            path.insert(0, urdf.parent(path[0]))
        first = next(index for index, link in enumerate(path) if link in moved)
        tail = [link for link in _rigid(end, urdf) if link not in path]
        chain = [link for link in [*path[first:], *tail] if link not in taken]
        taken |= set(chain)
        own = [urdf.joint_of_child[link].get("name", "") for link in chain if link in moved]
        own = [name for name in own if urdf.follower(urdf.joints[name]) is None]
        shaped = [link for link in chain if urdf.has_shape(link)]
        if shaped:
            fingers[_unique(_finger_name(shaped), fingers)] = (shaped, own)
            joints += own
        elif own:
            joints += own
            last = list(fingers)[-1] if fingers else PALM
            fingers[last] = (fingers[last][0], [*fingers[last][1], *own])
    palm = [link for link in _rigid(urdf.root, urdf) if urdf.has_shape(link)]
    return FingerTree(urdf.root, joints, fingers, palm)


def _children(link: str, urdf: Urdf) -> list[str]:
    return [child for child, joint in urdf.joint_of_child.items() if end_of(joint, "parent") == link]


def _rigid(link: str, urdf: Urdf) -> Iterator[str]:
    """Yield a link and what hangs on it without moving."""
    yield link
    for child in _children(link, urdf):
        if not urdf.moving(urdf.joint_of_child[child]):
            yield from _rigid(child, urdf)


def _carries_all(link: str, joints: list, urdf: Urdf) -> bool:  # type: ignore[type-arg]
    """Whether a link that does not move carries all of some joints."""
    rigid = set(_rigid(link, urdf))
    return not urdf.moving(urdf.joint_of_child[link]) and all(end_of(joint, "parent") in rigid for joint in joints)


def _moving_below(link: str, urdf: Urdf) -> list:  # type: ignore[type-arg]
    """Return the moving joints on a link or on what hangs on it rigidly."""
    rigid = set(_rigid(link, urdf))
    return [joint for joint in urdf.moving_joints.values() if end_of(joint, "parent") in rigid]


def _ends(link: str, urdf: Urdf) -> Iterator[str]:
    """Yield the last moving links of all chains that begin with a moving link."""
    onward = [end_of(joint, "child") for joint in _moving_below(link, urdf)]
    if not onward:
        yield link
    for child in onward:
        yield from _ends(child, urdf)


WORDS = {
    "thumb": ("thumb", "th"),
    "index": ("index", "if", "ff"),
    "ring": ("ring", "rf"),
    "little": ("pinky", "lf"),
    "middle": ("middle", "mf"),  # last: a phalanx is called so, too
}


def _finger_name(links: list[str]) -> str:
    """Return the name of a finger that its links' names contain, else that of its last link, in plain letters."""
    last = links[-1].lower()
    for name, words in WORDS.items():
        if words[0] in last or re.match(rf"(?:[rl]h_)?(?:{'|'.join(words[1:])})", last):
            return name
    plain = re.sub(r"[^a-z0-9]+", "_", last).strip("_")
    return plain if plain[:1].isalpha() else f"finger_{plain}"


def _unique(name: str, taken: dict[str, tuple[list[str], list[str]]]) -> str:
    number, found = 2, name
    while found in taken:
        found, number = f"{name}_{number}", number + 1
    return found
