"""Grasps of a block of 42 mm that the pipeline found, and a working folder with quick settings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from scipy.spatial.transform import Rotation

from pipeline.hand.model import Hand, load_hand
from tests.score.foreign_files import Own

# Thumb and middle finger on two faces; the grasp of examples/02_score_own_grasps.py.
R = [[0.0165, -0.2821, 0.9593], [-0.0575, 0.9575, 0.2825], [-0.9982, -0.0598, -0.0004]]
POSITION = [-0.0177, -0.0240, 0.0986]
INDEX, MIDDLE, RING = [0.177, 0.476, -0.140, 0.113], [0.163, 0.817, 0.541, 0.452], [0.069, -0.173, -0.148, -0.028]
THUMB = [1.394, 0.080, 0.568, 0.589]


@pytest.fixture(scope="session")
def hand() -> Hand:
    return load_hand("allegro")


def placed(turn: float = 0.0, shift: float = 0.0) -> Own:
    """The grasp, turned about the vertical by degrees and shifted along y by metres."""
    T, turned = np.eye(4), np.eye(4)
    T[:3, :3] = Rotation.from_matrix(R).as_matrix()
    T[:3, 3] = POSITION
    turned[:3, :3] = Rotation.from_euler("z", turn, degrees=True).as_matrix()
    turned[1, 3] = shift
    q = np.array(INDEX + MIDDLE + RING + THUMB)
    squeeze_q = q.copy()
    squeeze_q[[5, 6, 14, 15]] += 0.08  # middle finger and thumb bend
    return Own([turned @ T], q, squeeze_q, ["thumb+middle"], [[0, 1]])


@pytest.fixture
def grasps() -> list[Own]:
    """As found, turned by a quarter, and with the hand beside the block."""
    return [placed(), placed(turn=90.0), placed(shift=0.09)]


@pytest.fixture
def clone(empty_folder, repository) -> Path:
    """A working folder with the demo's settings, but two directions of gravity and one drawn condition."""
    content = yaml.safe_load((repository / "params.yaml").read_text())
    content["validate"] |= {"gravity_directions": ["-z", "+x"], "gravity_seconds": 0.5}
    content["robustness"] |= {"ladder": [], "conditions": 1}
    content["prepare"] |= {"distance_cells": 48, "surface_points": 2000}
    content["compute"]["workers"] = 1
    (empty_folder / "params.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    block = trimesh.creation.box([0.042] * 3)
    block.apply_translation([0.1, 0.0, 0.02])  # the frame of a file need not be that of the centre of mass
    block.export("block.stl")
    return empty_folder


def in_mesh_frame(own: Own) -> Own:
    """The same grasp in the frame of block.stl."""
    T = own.T_object_hand[0].copy()
    T[:3, 3] += [0.1, 0.0, 0.02]
    return Own([T], own.q, own.squeeze_q, own.fingers, own.contacts)
