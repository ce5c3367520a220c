"""`./dev describe-hand FILE`: a description of a hand, proposed from its URDF or MJCF, each guess marked as one."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from textwrap import indent
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from pipeline.hand.fitting import Solid
from pipeline.hand.meshes import solid
from pipeline.hand.model import Hand, hand_of_file
from pipeline.hand.moves import finger_joints
from pipeline.hand.standard import standard_urdf
from pipeline.hand.urdf import Urdf
from pipeline.records.errors import UserError, one_sentence
from pipeline.records.hands import DESCRIPTION, HANDS_FOLDER
from pipeline.records.parameters.hand import FINGER_NAME, PALM
from tools.finger_tree import FingerTree, finger_tree, spreading_link
from tools.hand_guesses import (
    HELD_RADIUS,
    Held,
    Meeting,
    finger_bases,
    groups,
    inner_contacts,
    meeting,
    meeting_near,
    opposing,
    overlapping_pairs,
)
from tools.mount_guess import guessed_mount
from tools.palm_press import PalmFace, Press, Stretched, facing, palm_contacts, presser, presses, sampled, stretched

DENSITY = 1000.0  # kg/m3
SLIDING = {"stiffness": 4000.0, "damping": 100.0}  # N/m, N s/m
LEAST_FORCE = 20.0  # N, of a sliding joint whose URDF says nothing
OPEN = 0.06  # m, radius of the ball about which fingertips are before they pinch
SMALLER = (HELD_RADIUS, 0.028, 0.021)  # m, of balls about which pinching fingers hold
# How initial hands are tilted: fingers that stand about the palm, and parallel fingers that point forward, as the
# Allegro's do.
ABOUT = {"axis": [0.0, 0.0, -1.0], "low": [-0.3, -0.3, -1.0], "high": [0.3, 0.3, -0.6]}
FORWARD = {"axis": [1.0, 0.0, 0.0], "low": [0.3, -0.5, -0.3], "high": [1.0, 0.5, 0.3]}
DECIMALS = 5  # of metres and radians: the tolerance of contacts is 0.5 mm


def _numbers(values: Any) -> Any:
    return (np.round(np.asarray(values, np.float64), DECIMALS) + 0.0).tolist()


def first_description(source: Path, title: str, place: dict[str, Any]) -> tuple[dict[str, Any], FingerTree, Urdf]:
    """Return what the tree of links alone says, without contacts, and that tree.

    Args:
        place: value of ``urdf`` but for the root.
    """
    whole = Urdf(standard_urdf(source, None, DENSITY), source)
    if whole.mistakes:
        raise UserError(one_sentence(source, whole.mistakes))
    root = spreading_link(whole)
    urdf = Urdf(standard_urdf(source, root, DENSITY), source)
    tree = finger_tree(urdf)
    if len(tree.fingers) < 2:
        raise UserError(f"{source}: a hand needs two fingers at least, and {root!r} carries {len(tree.fingers)}.")
    fingers: dict[str, Any] = {name: {"links": links, "joints": own} for name, (links, own) in tree.fingers.items()}
    drives = {}
    for name, joint in urdf.moving_joints.items():
        if urdf.slides(joint):
            drives[name] = SLIDING | ({} if urdf.effort(joint) else {"limit": LEAST_FORCE})
    content: dict[str, Any] = {
        "title": title,
        "urdf": place | {"root": root},
        "joints": tree.joints,
        "fingers": fingers | ({PALM: {"links": tree.palm}} if tree.palm else {}),
        "opposing": [],
        "palm_normal": [0.0, 0.0, 1.0],
        "tips": [links[-1] for links, _ in tree.fingers.values()],
        "contacts": {},
        "styles": {
            "pinch": {
                "fingers": list(tree.fingers),
                "orientation": np.eye(3).tolist(),
                "tilt": ABOUT,
                "posture": [0.0] * len(tree.joints),
            }
        },
    }
    if drives:
        content["drives"] = {"joints": drives}
    return content, tree, urdf


def looking_down(normal: NDArray[np.float64], along: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """Return the rotation R_object_hand (3, 3), by rows, that turns the palm's normal to -z of the object.

    Args:
        along: (3,) unit, what turns to +x; None: anything.
    """
    if along is None:
        along = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    along = along - (along @ normal) * normal
    along /= np.linalg.norm(along)
    return np.stack([along, np.cross(-normal, along), -normal])


@dataclass(frozen=True)
class Guesses:
    """What the kinematics say."""

    found: Meeting
    open_q: NDArray[np.float64]  # (J,) rad, tips about a ball that is larger than what is to be grasped
    opposing: list[str]
    straight: Mapping[str, Stretched]
    face: PalmFace
    press: Press | None  # of the finger that is left to press against the palm


def guessed(hand: Hand) -> Guesses:
    """Return what the kinematics of a hand say."""
    q = sampled(hand)
    straight = stretched(hand, q)
    opposed = opposing(meeting(hand), {finger: own.way for finger, own in straight.items()})
    found = meeting_near(hand, meeting(hand, opposed), opposed, HELD_RADIUS)
    face = facing(hand, found, straight, opposed)
    able = presses(hand, face, q)
    name = presser(hand, able, opposed)
    open_q = meeting_near(hand, found, opposed, OPEN).q
    return Guesses(found, open_q, opposed, straight, face, able[name] if name else None)


def _holding(hand: Hand, guesses: Guesses) -> dict[str, Any]:
    """Return the spread of postures in which each finger holds something, by finger."""
    found, press = {}, guesses.press
    meetings = [meeting_near(hand, guesses.found, guesses.opposing, radius).q for radius in SMALLER]
    for finger in guesses.straight:
        joints = finger_joints([finger], hand)
        if press is not None and finger == press.finger:
            found[finger] = {"first": _numbers(press.first), "bent": _numbers(press.bent)}
        elif len(joints) > 1:
            found[finger] = {
                "first": sorted({_numbers(q[joints[0]]) for q in meetings}),
                "bent": [_numbers(q[joints[1:]]) for q in meetings],
            }
    return found


def _lying(hand: Hand, press: Press, face: PalmFace, along: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation R_object_hand (3, 3) of a hand on its side: palm to +y, the pressing finger below."""
    base = finger_bases(hand)
    up = np.cross(along, face.normal)
    above = np.mean([place for finger, place in base.items() if finger != press.finger], axis=0) - base[press.finger]
    sign = 1.0 if up @ above >= 0 else -1.0
    return np.stack([sign * along, face.normal, sign * up])


def _styles(content: dict[str, Any], hand: Hand, guesses: Guesses) -> dict[str, Any]:
    """Return where the search for grasps starts, by style."""
    press, face = guesses.press, guesses.face
    others = [finger for finger in guesses.straight if press is None or finger != press.finger]
    pinch = content["styles"]["pinch"] | {
        "fingers": others,
        "orientation": _numbers(looking_down(face.normal, face.along)),
        "tilt": ABOUT if face.along is None else FORWARD,
        "posture": _numbers(guesses.open_q),
    }
    if press is None or face.along is None:
        return {"pinch": pinch}
    posture = guesses.found.q.copy()  # what pinches holds something
    posture[finger_joints([press.finger], hand)] = press.posture
    side = {
        "fingers": [press.finger, PALM],
        "orientation": _numbers(_lying(hand, press, face, face.along)),
        "tilt": {"axis": [0.0, 0.0, 1.0], "low": [-0.5, -0.5, 0.3], "high": [0.5, 0.5, 0.8]},
        "posture": _numbers(posture),
        "curled_like": press.finger,
        "held": [*others, press.finger],
    }
    return {"pinch": pinch | {"held": [press.finger], "waiting": [press.finger]}, "side": side}


def held_by(guesses: Guesses) -> dict[str, Held]:
    """Return what each finger holds: a ball between the tips, or a cylinder against the palm."""
    press = guesses.press
    ball = Held(guesses.found.q, guesses.found.centre, HELD_RADIUS)
    return dict.fromkeys(guesses.straight, ball) | ({press.finger: press.held} if press else {})


def solids_of(hand: Hand, urdf: Urdf) -> dict[str, list[Solid]]:
    """Return the convex solids that physics has for each link, link frame."""
    return {name: [Solid(solid(one)) for one in urdf.links[name].iter("collision")] for name in hand.link_names}


def completed(content: dict[str, Any], hand: Hand, guesses: Guesses, urdf: Urdf) -> dict[str, Any]:
    """Return the description with what the kinematics say."""
    pairs, holding = overlapping_pairs(hand), _holding(hand, guesses)
    contacts = inner_contacts(hand, held_by(guesses), solids_of(hand, urdf))
    fingers = {name: dict(own) for name, own in content["fingers"].items()}
    for finger, own in guesses.straight.items():
        fingers[finger] |= {"straight": _numbers(own.angles)}
        fingers[finger] |= {"holding": holding[finger]} if finger in holding else {}
    if guesses.press is not None:
        contacts = palm_contacts(hand, guesses.face) | contacts
    mount, touching = guessed_mount(hand, guesses.face)
    return content | {
        "fingers": fingers,
        "opposing": [*guesses.opposing, *([PALM] if guesses.press is not None else [])],
        "palm_normal": _numbers(guesses.face.normal),
        "contacts": {
            link: [{"points": _numbers(points), "normals": _numbers(normals)}]
            for link, (points, normals) in contacts.items()
        },
        "may_overlap": [list(pair) for pair in pairs],
        "never_meeting": [touching, *groups(pairs)],
        "mount": mount,
        "styles": _styles(content, hand, guesses),
    }


COMMENTS = {
    "urdf": "GUESS root: the link from which the fingers spread; what comes before it (arm, wrist) is left out.",
    "joints": "Joints that move by themselves, finger by finger.",
    "drives": "GUESS: joints that slide.",
    "fingers": "GUESS: one per end of the tree of links; `palm` is what does not move; straight: far out, little "
    "turned; holding: about balls, or cylinders on the palm, of some sizes.",
    "opposing": "GUESS: the finger that the others face where their tips meet, and the palm that a finger can press "
    "against; empty: none.",
    "palm_normal": "GUESS: to where the fingertips meet, across the stretched fingers unless they point there.",
    "tips": "GUESS: the last links.",
    "contacts": "GUESS: points of a finger's last three links that face what is held, and the flat of the palm.",
    "may_overlap": "Shapes that overlap in nearly all of 30 random postures.",
    "never_meeting": "The same pairs, and what touches the mount: physics leaves them out.",
    "mount": "GUESS: a block on the flange of the Panda; the palm faces the way of its z, the fingers point to -y.",
    "styles": "GUESS pinch: the hand looks down, and `posture` has the tips about a ball of 60 mm radius. "
    "GUESS side: the hand lies on its side, and one finger presses a cylinder of 30 mm radius against the palm.",
}


def text_of(content: dict[str, Any], question: str) -> str:
    """Return the description as YAML with a comment on every guess."""
    lines = [
        "# Proposed by `./dev describe-hand`. Check what is marked GUESS; docs/another-hand.md explains the fields."
    ]
    lines += [f"# QUESTION: {question}"] if question else []
    for name, value in content.items():
        lines += [f"# {COMMENTS[name]}"] if name in COMMENTS else []
        dumped = yaml.safe_dump(value, sort_keys=False, default_flow_style=None, width=116).removesuffix("...\n")
        body = indent(dumped.rstrip(), "  ")
        in_block = isinstance(value, dict | list) and not dumped.startswith(("{", "["))
        lines.append(f"{name}:\n{body}" if in_block else f"{name}: {body.lstrip()}")
    return "\n".join(lines) + "\n"


def settings_of(name: str, content: dict[str, Any], guesses: Guesses) -> str:
    """Return `conf/hand/<name>.yaml`: which fingers hold, and how far the palm is at first.

    A hand that cannot press against its palm gets objects of its own, as those of a scale ask for both styles.
    """
    fingers = content["styles"]["pinch"]["fingers"]
    first = guesses.opposing or fingers[:1]
    others = [finger for finger in fingers if finger not in first]
    sets = [[*first, other] for other in others]
    sets += [[*first, one, other] for one, other in zip(others, others[1:], strict=False)]
    if not guesses.opposing and len(others) > 1:
        sets += [[one, other] for one, other in zip(others, others[1:], strict=False)]
    pinch: dict[str, Any] = {
        "finger_sets": sets,
        "contacts": {"+".join(own): len(own) for own in sets},
        "keep_out_margin": None,
    }
    if guesses.face.along is None:
        reach = float(guesses.found.centre @ guesses.face.normal)
        nearest = max(reach - 0.02, 0.01)
        pinch |= {"distance_from_palm": _numbers([nearest, nearest + 0.06]), "heading_spread": 3.1416}
    synthesis: dict[str, Any] = {"pinch": pinch}
    if guesses.press is not None:
        own = [guesses.press.finger, PALM]
        synthesis["side"] = {
            "finger_sets": [own],
            "contacts": {"+".join(own): 2},
            "mount_clearance": None,
            "keep_out_margin": None,
            "distance_from_palm": _numbers(np.array([0.03, 0.12]) + guesses.face.height),
        }
    styles = {} if guesses.press else {"styles": {"pinch": ["cube", "slender_cylinder"], "side": []}}
    body = {"hand": name, **styles, "synthesize": synthesis}
    head = f"# @package _global_\n# Proposed by `./dev describe-hand` with hands/{name}/{DESCRIPTION}.\n"
    return head + yaml.safe_dump(body, sort_keys=False, default_flow_style=None, width=118)


def describe(source: Path, name: str) -> tuple[str, str]:
    """Return the texts of `hand.yaml` and of the settings.

    Raises:
        UserError: the file is no hand, or cannot be read.
    """
    if not FINGER_NAME.fullmatch(name):
        raise UserError(f"the name {name!r}: use lower-case letters, digits and underscores, and begin with a letter.")
    content, _, urdf = first_description(source, source.stem.replace("_", " "), {"path": str(source)})
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / DESCRIPTION
        file.write_text(yaml.safe_dump(content, sort_keys=False))
        hand = hand_of_file(file)
    guesses = guessed(hand)
    content = completed(content, hand, guesses, urdf)
    question = ""
    if guesses.found.miss > 0.01:
        question = (
            f"the fingertips do not close about a ball of 35 mm radius ({1000 * guesses.found.miss:.0f} mm off at "
            "best); which fingers hold objects, and how? Correct fingers, opposing and styles.pinch.posture."
        )
    return text_of(content, question), settings_of(name, content, guesses)


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="./dev describe-hand", description=__doc__)
    parser.add_argument("file", type=Path, help="URDF or MJCF of the hand")
    parser.add_argument("--folder", type=Path, default=Path.cwd(), help="what FILE is relative to")
    parser.add_argument("--name", required=True, help="name of the hand, and of its folder in hands/")
    given = parser.parse_args(arguments)
    folder, settings = HANDS_FOLDER / given.name, HANDS_FOLDER.parent / "conf" / "hand" / f"{given.name}.yaml"
    try:
        if folder.exists() or settings.exists():
            raise UserError(
                f"there is a hand {given.name} already ({folder}, {settings}); remove it, or use another name."
            )
        description, conf = describe((given.folder / given.file).resolve(), given.name)
    except UserError as error:
        print(f"describe-hand: {error}", file=sys.stderr)
        return 1
    folder.mkdir(parents=True)
    (folder / DESCRIPTION).write_text(description)
    settings.write_text(conf)
    print(f"wrote {folder / DESCRIPTION} and {settings}; read what is marked GUESS, then run")
    print(f"  ./dev compose demo --hand {given.name}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
