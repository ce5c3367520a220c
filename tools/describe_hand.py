"""`./dev describe-hand FILE`: a description of a hand, proposed from its URDF or MJCF, each guess marked as one."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from textwrap import indent
from typing import Any

import numpy as np
import yaml

from pipeline.hand.model import Hand, hand_of_file
from pipeline.hand.standard import standard_urdf
from pipeline.hand.urdf import Urdf
from pipeline.records.errors import UserError, one_sentence
from pipeline.records.hands import DESCRIPTION, HANDS_FOLDER
from pipeline.records.parameters.hand import FINGER_NAME, PALM
from tools.finger_tree import FingerTree, finger_tree, spreading_link
from tools.hand_guesses import Meeting, groups, inner_contacts, meeting, opposing, overlapping_pairs

DENSITY = 1000.0  # kg/m3
SLIDING = {"stiffness": 4000.0, "damping": 100.0}  # N/m, N s/m
LEAST_FORCE = 20.0  # N, of a sliding joint whose URDF says nothing
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
                "tilt": {"axis": [0.0, 0.0, -1.0], "low": [-0.3, -0.3, -1.0], "high": [0.3, 0.3, -0.6]},
                "posture": [0.0] * len(tree.joints),
            }
        },
    }
    if drives:
        content["drives"] = {"joints": drives}
    return content, tree, urdf


def looking_down(normal: np.ndarray) -> np.ndarray:
    """Return the rotation (3, 3) that turns a unit vector of the hand to -z of the object, by rows."""
    side = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    side /= np.linalg.norm(side)
    return np.stack([side, np.cross(-normal, side), -normal])


def completed(content: dict[str, Any], hand: Hand, found: Meeting) -> dict[str, Any]:
    """Return the description with what the kinematics say."""
    normal = found.centre / np.linalg.norm(found.centre)
    pairs = overlapping_pairs(hand)
    pinch = content["styles"]["pinch"] | {"orientation": _numbers(looking_down(normal)), "posture": _numbers(found.q)}
    return content | {
        "opposing": opposing(found),
        "palm_normal": _numbers(normal),
        "contacts": {
            link: [{"points": _numbers(points), "normals": _numbers(normals)}]
            for link, (points, normals) in inner_contacts(hand, found).items()
        },
        "may_overlap": [list(pair) for pair in pairs],
        "never_meeting": groups(pairs),
        "styles": {"pinch": pinch},
    }


COMMENTS = {
    "urdf": "GUESS root: the link from which the fingers spread; what comes before it (arm, wrist) is left out.",
    "joints": "Joints that move by themselves, finger by finger.",
    "drives": "GUESS: joints that slide.",
    "fingers": "GUESS: one per end of the tree of links, named by its links; `palm` is what does not move.",
    "opposing": "GUESS: the finger that the others face where their tips meet; empty: none.",
    "palm_normal": "GUESS: towards where the fingertips meet.",
    "tips": "GUESS: the last links.",
    "contacts": "GUESS: points of the last two links that look to where the fingertips meet.",
    "may_overlap": "Shapes that overlap in nearly all of 30 random postures.",
    "never_meeting": "The same pairs: physics leaves them out.",
    "styles": "GUESS: the hand looks down on the object; `posture` closes the tips about a ball of 35 mm radius.",
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
        in_block = isinstance(value, dict) and not dumped.startswith("{")
        lines.append(f"{name}:\n{body}" if in_block else f"{name}: {body.lstrip()}")
    return "\n".join(lines) + "\n"


def settings_of(name: str, content: dict[str, Any], found: Meeting) -> str:
    """Return `conf/hand/<name>.yaml`: which fingers hold, and how far the palm is at first."""
    fingers = [finger for finger in content["fingers"] if finger != PALM]
    first = content["opposing"] or fingers[:1]
    others = [finger for finger in fingers if finger not in first]
    sets = [[*first, other] for other in others]
    sets += [[*first, one, other] for one, other in zip(others, others[1:], strict=False)]
    if not content["opposing"] and len(others) > 1:
        sets += [[one, other] for one, other in zip(others, others[1:], strict=False)]
    reach = float(np.linalg.norm(found.centre))
    pinch = {
        "finger_sets": sets,
        "contacts": {"+".join(own): len(own) for own in sets},
        "starts": 2,
        "keep_out_margin": None,
        "distance_from_palm": _numbers([max(reach - 0.02, 0.01), reach + 0.04]),
        "heading_spread": 3.1416,
    }
    body = {"hand": name, "styles": {"pinch": ["cube", "slender_cylinder"], "side": []}, "synthesize": {"pinch": pinch}}
    head = f"# @package _global_\n# Proposed by `./dev describe-hand` with hands/{name}/{DESCRIPTION}.\n"
    return head + yaml.safe_dump(body, sort_keys=False, default_flow_style=None, width=118)


def describe(source: Path, name: str) -> tuple[str, str]:
    """Return the texts of `hand.yaml` and of the settings.

    Raises:
        UserError: the file is no hand, or cannot be read.
    """
    if not FINGER_NAME.fullmatch(name):
        raise UserError(f"the name {name!r}: use lower-case letters, digits and underscores, and begin with a letter.")
    content, _, _ = first_description(source, source.stem.replace("_", " "), {"path": str(source)})
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / DESCRIPTION
        file.write_text(yaml.safe_dump(content, sort_keys=False))
        hand = hand_of_file(file)
    found = meeting(hand)
    content = completed(content, hand, found)
    question = ""
    if found.miss > 0.01:
        question = (
            f"the fingertips do not close about a ball of 35 mm radius ({1000 * found.miss:.0f} mm off at best); "
            "which fingers hold objects, and how? Correct fingers, opposing and styles.pinch.posture."
        )
    return text_of(content, question), settings_of(name, content, found)


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
