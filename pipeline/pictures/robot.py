"""Bodies of a hand and of the whole robot in a given posture, from the visual meshes of their descriptions."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio
import trimesh
from numpy.typing import NDArray

from pipeline.hand.meshes import read_mesh, solid
from pipeline.hand.model import Hand
from pipeline.hand.robot import all_joint_names, all_positions, compose_robot
from pipeline.hand.urdf import origin_matrix, vector
from pipeline.pictures.decimation import Mesh, decimated
from pipeline.pictures.render import Body, corner_normals
from pipeline.records.parameters.hand import MOUNT_LINK

LARGEST_MESH = 4000  # faces; finer visual meshes are decimated, as no picture shows the difference
HAND_COLOUR = (0.33, 0.35, 0.39)
TIP_COLOUR = (0.88, 0.88, 0.86)
ARM_COLOUR = (0.90, 0.91, 0.92)
JOINT_COLOUR = (0.28, 0.29, 0.31)
MOUNT_COLOUR = (0.45, 0.47, 0.50)


@dataclass(frozen=True)
class _Visual:
    """One coloured mesh of a link, in the link frame."""

    link: str
    body: Body


def _few_faces(mesh: Any) -> Mesh:
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    return decimated((np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)), LARGEST_MESH)


def _colour(link: str, mesh: Any, tips: frozenset[str]) -> tuple[float, float, float]:
    if link in tips:
        return TIP_COLOUR
    if not link.startswith("panda"):
        return HAND_COLOUR
    base = getattr(getattr(mesh.visual, "material", None), "baseColorFactor", None)
    return JOINT_COLOUR if base is not None and max(base[:3]) < 60 else ARM_COLOUR


@lru_cache(maxsize=64)
def _file_meshes(path: Path) -> list[Any]:
    """Return the meshes of a file with the transforms of its scene applied."""
    if path.suffix.lower() == ".dae":
        return [read_mesh(path)]
    loaded = trimesh.load(path, process=False)
    return list(loaded.dump()) if isinstance(loaded, trimesh.Scene) else [loaded]


@lru_cache(maxsize=4)
def _visuals(arm: bool, hand: Hand) -> tuple[_Visual, ...]:
    visuals = []
    for link in ElementTree.fromstring(compose_robot(arm, visuals=True, hand=hand)).iter("link"):
        name = link.get("name", "")
        shapes = link.findall("visual") or (link.findall("collision") if name == MOUNT_LINK else [])
        for shape in shapes:
            T, scale = origin_matrix(shape.find("origin")), np.ones(3)
            mesh_element, box = shape.find("geometry/mesh"), shape.find("geometry/box")
            if mesh_element is not None:
                meshes = _file_meshes(Path(mesh_element.get("filename", "")))
                scale = vector(mesh_element.get("scale", "1 1 1"))
            elif box is not None:
                meshes = [trimesh.creation.box([float(part) for part in box.get("size", "").split()])]
            elif shape.find("geometry") is not None:
                meshes, T = [solid(shape)], np.eye(4)
            else:
                continue
            for mesh in meshes:
                vertices, faces = _few_faces(mesh.copy())
                vertices = (scale * vertices) @ T[:3, :3].T + T[:3, 3]
                colour = MOUNT_COLOUR if name == MOUNT_LINK else _colour(name, mesh, hand.tips)
                visuals.append(_Visual(name, Body(vertices, faces, colour, np.eye(4), corner_normals(vertices, faces))))
    return tuple(visuals)


@lru_cache(maxsize=4)
def _kinematics(arm: bool, hand: Hand) -> tuple[Any, Any, NDArray[np.int64]]:
    """Pinocchio's model, and where each of our joints stands in its configuration vector."""
    model = pinocchio.buildModelFromXML(compose_robot(arm, visuals=False, hand=hand))
    names = all_joint_names(arm, hand)
    return model, model.createData(), np.array([model.joints[model.getJointId(name)].idx_q for name in names])


def _bodies(arm: bool, hand: Hand, T_world_root: NDArray[np.float64], q: NDArray[np.float64]) -> list[Body]:
    model, data, index = _kinematics(arm, hand)
    configuration = np.zeros(model.nq)
    configuration[index] = all_positions(arm, hand, q)
    pinocchio.framesForwardKinematics(model, data, configuration)
    return [
        visual.body.placed(T_world_root @ data.oMf[model.getFrameId(visual.link)].homogeneous)
        for visual in _visuals(arm, hand)
    ]


def hand_bodies(T_world_hand: NDArray[np.float64], q: NDArray[np.float64], hand: Hand) -> list[Body]:
    """Return the links of a hand.

    Args:
        T_world_hand: (4, 4) pose of the root link.
        q: (J,) joint angles, rad.
    """
    return _bodies(False, hand, T_world_hand, np.asarray(q, np.float64))


def robot_bodies(q: NDArray[np.float64], hand: Hand) -> list[Body]:
    """Return the links of arm, mount and hand, ``panda_link0`` at the world's origin.

    Args:
        q: (7 + J,) the arm's joint angles, then the hand's, rad.
        hand: one that has a mount.
    """
    return _bodies(True, hand, np.eye(4), np.asarray(q, np.float64))
