"""How a hand is mounted on the Panda: a proposal for its description, from the shape of its palm.

As the paper mounts the Allegro: the palm faces the way of the flange's z, the fingers point to -y, and a small block
holds the rear end of the palm. A palm about which the fingers stand is centred on the block.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.hand.kinematics import link_poses
from pipeline.hand.model import Hand
from pipeline.hand.surface import hand_surface
from pipeline.records.parameters.hand import FLANGE_LINK, MOUNT_LINK, PALM
from tools.hand_guesses import distance_to_link
from tools.palm_press import PalmFace

FLANGE = 0.107  # m, from the frame of panda_link7 to the surface of its flange
BLOCK, ASIDE = (0.05, 0.065, 0.034), -0.02  # m, x, y, z of the mount, and where the middle of its y is; as in the paper
REAR = -0.045  # m, y of the palm's rear end in the frame of the flange: inside the block. As in the paper.
NEAR = 0.005  # m
MOSTLY = 0.5  # share of postures: a link that is so near to the block in more of them touches it by design
POSTURES = 20


def guessed_mount(hand: Hand, face: PalmFace) -> tuple[dict[str, Any], list[str]]:
    """Return `mount` of the description, and the links of the hand that touch the mount by design.

    Args:
        hand: without a mount.
        face: where the palm faces, and the fingers point.
    """
    along = np.cross(face.normal, np.eye(3)[np.abs(face.normal).argmin()]) if face.along is None else face.along
    along = along - (along @ face.normal) * face.normal
    along /= np.linalg.norm(along)
    R = np.stack([np.cross(-along, face.normal), -along, face.normal])  # R_flange_hand
    palm = [hand.link(name) for name in hand.finger_links.get(PALM, (hand.root,))]
    owner, local = hand_surface(4000, hand)
    T = link_poses(hand, ((hand.lower + hand.upper) / 2)[None])[0]
    points = np.concatenate([local[owner == link] @ T[link, :3, :3].T + T[link, :3, 3] for link in palm])
    low, high = (points @ R.T).min(0), (points @ R.T).max(0)
    middle, thickness = (low + high) / 2, high[2] - low[2]
    if face.along is None:
        origin = np.array([-middle[0], ASIDE - middle[1], BLOCK[2] - low[2]])
    else:
        origin = np.array([-middle[0], REAR - high[1], max(BLOCK[2], thickness) / 2 - middle[2]])
    mount = {
        "origin": {"xyz": [0.0, 0.0, FLANGE]},
        "hand": {
            "xyz": np.round(origin, 4).tolist(),
            "rpy": _roll_pitch_yaw(R),
        },
        "mass": 0.05,
        "inertia": [2e-5, 2e-5, 2e-5],
        "box": {"origin": {"xyz": [0.0, ASIDE, BLOCK[2] / 2]}, "size": list(BLOCK)},
    }
    return mount, _touching(hand, R, origin, palm)


def _roll_pitch_yaw(R: NDArray[np.float64]) -> list[float]:
    """Return angles about fixed axes, rad, of a rotation (3, 3); the third is zero where only two are determined."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        angles: list[float] = np.round(Rotation.from_matrix(R).as_euler("xyz"), 6).tolist()
    return angles


def _touching(hand: Hand, R: NDArray[np.float64], origin: NDArray[np.float64], palm: list[int]) -> list[str]:
    """Return the palm's links, and those that are near the block in most random postures."""
    axes = [np.linspace(-size / 2, size / 2, 8) for size in BLOCK]
    block = np.stack(np.meshgrid(*axes), -1).reshape(-1, 3) + [0.0, ASIDE, BLOCK[2] / 2]
    inside = (block - origin) @ R  # hand frame
    rng = np.random.Generator(np.random.PCG64(3))
    T = link_poses(hand, rng.uniform(hand.lower, hand.upper, (POSTURES, hand.joint_count)))
    near = []
    for link in sorted({*hand.box_link.tolist(), *hand.sphere_link.tolist(), *palm}):
        points = np.einsum("bji,bnj->bni", T[:, link, :3, :3], inside - T[:, link, None, :3, 3])
        distance = distance_to_link(hand, link, points.reshape(-1, 3)).reshape(POSTURES, -1).min(1)
        if link in palm or (distance < NEAR).mean() > MOSTLY:
            near.append(hand.link_names[link])
    return [FLANGE_LINK, MOUNT_LINK, *near]
