"""Meshes of hand and robot in as few faces as are seen, and where postures put their links."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.kinematics import link_poses
from pipeline.hand.model import Hand
from pipeline.hand.parts import part_links
from pipeline.hand.robot import robot_joint_names
from pipeline.pictures.decimation import Mesh, decimated
from pipeline.pictures.render import Body
from pipeline.pictures.robot import TIP_COLOUR, hand_bodies, robot_bodies
from pipeline.view.drawing import Solid

ONE_LINK = 1000  # faces of a link of the only hand or robot; as in replays
MANY_LINK = 250  # faces of a link where there are many hands
ONE_OBJECT, MANY_OBJECT, COARSE_OBJECT = 20000, 2000, 300  # faces of an object, of many, of very many


@lru_cache(maxsize=4)
def _links(arm: bool, most_faces: int, hand: Hand) -> tuple[tuple[Mesh, tuple[float, float, float]], ...]:
    if arm:
        bodies: list[Body] = robot_bodies(np.zeros(len(robot_joint_names(hand))), hand)
    else:
        bodies = hand_bodies(np.eye(4), np.zeros(hand.joint_count), hand)
    return tuple((decimated((body.vertices, body.faces), most_faces), body.colour) for body in bodies)


def hands(
    T_world_hand: NDArray[np.float64],
    q: NDArray[np.float64],
    hand: Hand,
    colours: NDArray[np.float64] | None = None,
    opacity: float = 1.0,
) -> list[Solid]:
    """Return the links of hands.

    Args:
        T_world_hand: (n, 4, 4).
        q: (n, J), rad.
        colours: (n, 3); the hand's own when absent. Fingertips keep theirs but for a tint.
    """
    poses = np.array(
        [[body.T_world for body in hand_bodies(T, angles, hand)] for T, angles in zip(T_world_hand, q, strict=True)]
    )
    faces = ONE_LINK if len(q) == 1 else MANY_LINK
    solids = []
    for number, ((vertices, triangles), own) in enumerate(_links(False, faces, hand)):
        tint = np.tile(own, (len(q), 1)) if colours is None else np.asarray(colours, np.float64)
        if colours is not None and own == TIP_COLOUR:
            tint = 0.5 * tint + 0.5 * np.asarray(own)
        solids.append(Solid(f"hand/{number:02d}", vertices, triangles, poses[:, number], tint, opacity))
    return solids


def robot(q: NDArray[np.float64], hand: Hand) -> list[Solid]:
    """Return the links of arm and hand at ``q`` (7 + J,), rad, standing at the world's origin."""
    return [
        Solid(f"robot/{number:02d}", vertices, faces, body.T_world[None], np.array([colour]))
        for number, (body, ((vertices, faces), colour)) in enumerate(
            zip(robot_bodies(q, hand), _links(True, ONE_LINK, hand), strict=True)
        )
    ]


def sticks(
    T_world_hand: NDArray[np.float64], q: NDArray[np.float64], fingers: Sequence[str], hand: Hand
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
    """Return hands as lines from the wrist through the joints to the tips, of the fingers that hold something.

    Args:
        T_world_hand: (n, 4, 4).
        q: (n, J), rad.
        fingers: per hand, such as ``thumb+index``; the palm is the wrist.

    Returns:
        Segments (m, 2, 3) and of which hand each is (m,); tips (k, 3) and of which hand each is (k,).
    """
    joints = (T_world_hand[:, None] @ link_poses(hand, q))[..., :3, 3]
    segments, owners, tips, tip_owners = [], [], [], []
    for row, names in enumerate(fingers):
        for finger in names.split("+"):
            if finger == "palm":
                continue
            chain = joints[row, [0, *(hand.link(name) for name in part_links([finger], hand))]]
            segments.append(np.stack([chain[:-1], chain[1:]], axis=1))
            owners += [row] * (len(chain) - 1)
            tips.append(chain[-1])
            tip_owners.append(row)
    if not segments:
        return np.zeros((0, 2, 3)), np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0, np.int64)
    return np.concatenate(segments), np.array(owners), np.array(tips), np.array(tip_owners)


_LESS: dict[tuple[int, int], tuple[Mesh, Mesh]] = {}
MOST_KEPT = 64


def fewer_faces(mesh: Mesh, most_faces: int) -> Mesh:
    """Return ``decimated(mesh, most_faces)``, kept for the next time that the same arrays are asked for."""
    if len(mesh[1]) <= most_faces:
        return mesh
    key = (id(mesh[0]), most_faces)
    if key not in _LESS or _LESS[key][0][0] is not mesh[0]:
        while len(_LESS) >= MOST_KEPT:
            del _LESS[next(iter(_LESS))]
        _LESS[key] = (mesh, decimated(mesh, most_faces))
    return _LESS[key][1]
