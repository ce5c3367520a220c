"""The least description of a hand that its tree of links gives, without contacts: for its kinematics and shapes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from pipeline.hand.standard import standard_urdf
from pipeline.hand.urdf import Urdf
from tools.finger_tree import finger_tree, spreading_link

DENSITY = 1000.0  # kg/m3


def write_description(folder: Path, source: Path, changes: dict[str, Any] | None = None) -> Path:
    """Write `hand.yaml` for a URDF or MJCF into a folder and return it; sliding joints get a drive."""
    root = spreading_link(Urdf(standard_urdf(source, None, DENSITY), source))
    urdf = Urdf(standard_urdf(source, root, DENSITY), source)
    tree = finger_tree(urdf)
    fingers: dict[str, Any] = {name: {"links": own, "joints": moved} for name, (own, moved) in tree.fingers.items()}
    sliding = [name for name, joint in urdf.moving_joints.items() if urdf.slides(joint)]
    content = {
        "title": source.stem,
        "urdf": {"path": str(source), "root": root},
        "joints": tree.joints,
        "fingers": fingers | ({"palm": {"links": tree.palm}} if tree.palm else {}),
        "opposing": [],
        "palm_normal": [0.0, 0.0, 1.0],
        "tips": [links[-1] for links, _ in tree.fingers.values()],
        "contacts": {},
        "drives": {"joints": {name: {"stiffness": 4000.0, "damping": 100.0, "limit": 40.0} for name in sliding}},
        "styles": {
            "pinch": {
                "fingers": list(tree.fingers)[:2],
                "orientation": [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
                "tilt": {"axis": [0.0, 0.0, -1.0], "low": [-0.2, -0.2, -1.0], "high": [0.2, 0.2, -0.8]},
                "posture": [0.0] * len(tree.joints),
            }
        },
    }
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "hand.yaml"
    file.write_text(yaml.safe_dump(content | (changes or {}), sort_keys=False))
    return file
