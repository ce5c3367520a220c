"""A made-up hand of three fingers with two joints each, written as its user would: a URDF and a description."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

FINGERS = ("left", "right", "far")
ANGLES = (0.0, 2.0943951, 4.1887902)  # rad, where the fingers stand about the palm's z
TIP = 0.008  # m


def _box(size: str, centre: str) -> str:
    return f'<collision><origin xyz="{centre}"/><geometry><box size="{size}"/></geometry></collision>'


def _finger(name: str, angle: float) -> str:
    ball = f'<collision><origin xyz="0 0 0.04"/><geometry><sphere radius="{TIP}"/></geometry></collision>'
    return f"""
      <joint name="{name}_turn" type="revolute">
        <parent link="{name}_mount"/><child link="{name}_near"/>
        <origin xyz="0.05 0 0.01"/><axis xyz="0 -2 0"/><limit lower="-0.4" upper="1.4" effort="5" velocity="5"/>
      </joint>
      <joint name="{name}_bend" type="revolute">
        <parent link="{name}_near"/><child link="{name}_tip"/>
        <origin xyz="0 0 0.06" rpy="0 0.1 0"/><axis xyz="0 -1 0"/>
        <limit lower="-0.2" upper="1.5" effort="5" velocity="5"/>
      </joint>
      <joint name="{name}_place" type="fixed">
        <parent link="plate"/><child link="{name}_mount"/><origin xyz="0 0 0" rpy="0 0 {angle}"/>
      </joint>
      <link name="{name}_mount"/>
      <link name="{name}_near">{_box("0.012 0.014 0.05", "0 0 0.03")}</link>
      <link name="{name}_tip">{_box("0.01 0.012 0.032", "0 0 0.02")}{ball}</link>"""


def urdf_text() -> str:
    """Return the URDF: a plate, fingers on links without shapes, and a frame that nothing hangs on."""
    fingers = "".join(_finger(name, angle) for name, angle in zip(FINGERS, ANGLES, strict=True))
    frame = """
      <link name="camera"/>
      <joint name="camera_joint" type="fixed"><parent link="plate"/><child link="camera"/></joint>"""
    return f'<robot name="toy"><link name="plate">{_box("0.12 0.12 0.02", "0 0 0")}</link>{fingers}{frame}</robot>'


def coupled_urdf() -> str:
    """Return the URDF with two couplings: the left finger's second joint follows its first, and the far one's likewise.

    The far finger's first joint slides.
    """
    text = urdf_text()
    for name, mimic in (
        ("left", '<mimic joint="left_turn" multiplier="1.2" offset="-0.1"/>'),
        ("far", '<mimic joint="far_turn" multiplier="-20" offset="0.3"/>'),
    ):
        marker = f'<parent link="{name}_near"/><child link="{name}_tip"/>'
        assert marker in text
        text = text.replace(marker, marker + mimic)
    slider = '<joint name="far_turn" type="prismatic">'
    start = text.index('<joint name="far_turn" type="revolute">')
    end = text.index("</joint>", start)
    own = text[start:end].replace('<joint name="far_turn" type="revolute">', slider)
    own = own.replace('lower="-0.4" upper="1.4" effort="5"', 'lower="-0.04" upper="0.03" effort="40"')
    return text[:start] + own + text[end:]


def coupled_changes() -> dict[str, Any]:
    """Return what the description of that hand says differently."""
    base = description()
    base["fingers"]["left"]["joints"] = ["left_turn"]
    base["fingers"]["far"]["joints"] = ["far_turn"]
    base["styles"]["pinch"]["posture"] = [0.1, 0.1, 0.2, 0.0]
    return {
        "joints": ["left_turn", "right_turn", "right_bend", "far_turn"],
        "fingers": base["fingers"],
        "styles": base["styles"],
        "drives": {"joints": {"far_turn": {"stiffness": 4000.0, "damping": 100.0}}},
    }


def write_coupled(folder: Path) -> Path:
    """Write the toy with couplings and a sliding joint, and return its description's file."""
    return write_toy(folder, coupled_changes(), coupled_urdf())


def description() -> dict[str, Any]:
    """Return what the description says."""
    return {
        "title": "Toy",
        "urdf": {"path": "toy.urdf"},
        "joints": [f"{name}_{joint}" for name in FINGERS for joint in ("turn", "bend")],
        "fingers": {
            **{
                name: {"joints": [f"{name}_turn", f"{name}_bend"], "links": [f"{name}_near", f"{name}_tip"]}
                for name in FINGERS
            },
            "palm": {"links": ["plate"]},
        },
        "opposing": ["left"],
        "palm_normal": [0.0, 0.0, 1.0],
        "tips": [f"{name}_tip" for name in FINGERS],
        "contacts": {
            f"{name}_tip": [
                {"normal": "-x", "grid": {"x": [-0.005], "y": [-0.004, 0.004], "z": [0.01, 0.03]}},
                {"cap": {"axis": "+z", "front": "-x", "polar": [1.4, 0.4], "azimuth": 1.0, "counts": [4, 3]}},
            ]
            for name in FINGERS
        },
        "styles": {
            "pinch": {
                "fingers": list(FINGERS),
                "orientation": [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
                "tilt": {"axis": [0.0, 0.0, -1.0], "low": [-0.2, -0.2, -1.0], "high": [0.2, 0.2, -0.8]},
                "posture": [0.1, 0.2] * 3,
            }
        },
    }


def write_toy(folder: Path, changes: dict[str, Any] | None = None, urdf: str | None = None) -> Path:
    """Write the hand into a folder and return its description's file; ``changes`` replace fields."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "toy.urdf").write_text(urdf_text() if urdf is None else urdf)
    file = folder / "hand.yaml"
    file.write_text(yaml.safe_dump({**description(), **(changes or {})}, sort_keys=False))
    return file
