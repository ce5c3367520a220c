"""Geometry of merged grasps for the interactive views: every shape is stored once, every grasp places it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.records.poses import pose_matrix

Mesh = tuple[NDArray[np.float64], NDArray[np.int64]]  # vertices (V, 3), m; faces (F, 3)

UNIT = 1e-4  # m; vertices are stored as whole multiples of it
MOST_FACES = 1200  # of an object
MOST_LINK_FACES = 350
GRASPS_PER_PAIR = 6
OBJECT_COLOURS = ("#e08a2e", "#3c78b4")  # first object, second object
FINGER_COLOURS = {"thumb": "#8f9aa3", "index": "#9aa5ad", "middle": "#a6b0b7", "ring": "#b8a48f", "palm": "#6f7a83"}


def decimated(mesh: Mesh, most_faces: int) -> Mesh:
    """Return the mesh with at most about ``most_faces`` faces (quadric edge collapse), or unchanged if it has fewer."""
    vertices, faces = mesh
    if len(faces) <= most_faces:
        return mesh
    import open3d

    full = open3d.geometry.TriangleMesh(open3d.utility.Vector3dVector(vertices), open3d.utility.Vector3iVector(faces))
    full.merge_close_vertices(1e-7)
    less = full.simplify_quadric_decimation(most_faces)
    return np.asarray(less.vertices), np.asarray(less.triangles, dtype=np.int64)


def shape_record(mesh: Mesh) -> dict[str, list[int]]:
    """Return the mesh as flat lists of whole numbers: vertices in multiples of ``UNIT``, faces as vertex indices."""
    vertices, faces = mesh
    return {
        "vertices": np.rint(vertices / UNIT).astype(int).ravel().tolist(),
        "faces": faces.astype(int).ravel().tolist(),
    }


def body_record(shape: str, T_hand_body: NDArray[np.float64], colour: str, name: str) -> dict[str, Any]:
    """Return one placed shape; the pose is the upper three rows of ``T_hand_body`` (4, 4)."""
    pose = [round(float(value), 6) + 0.0 for value in T_hand_body[:3].ravel()]
    return {"shape": shape, "pose": pose, "colour": colour, "name": name}


def shown_grasps(merged: pd.DataFrame, preferred: Sequence[int], most: int = GRASPS_PER_PAIR) -> pd.DataFrame:
    """Return accepted grasps to show: the ``preferred`` merged ids first (as the robot used them), then by id."""
    accepted = merged[merged["rejected_by"] == ""].sort_values("merged_id")
    rank = {merged_id: index for index, merged_id in enumerate(dict.fromkeys(preferred))}
    order = accepted["merged_id"].map(lambda merged_id: rank.get(merged_id, len(rank)))
    return accepted.assign(_order=order).sort_values(["_order", "merged_id"]).head(most).drop(columns="_order")


def grasp_record(
    grasp: Mapping[str, Any],
    T_hand_link: Mapping[str, NDArray[np.float64]],
    link_fingers: Mapping[str, str],
) -> dict[str, Any]:
    """Return one merged grasp: the hand's links and both objects, placed in the hand frame.

    Args:
        grasp: a row of a merged table.
        T_hand_link: pose of every drawn link.
        link_fingers: finger of every drawn link.
    """
    bodies = [
        body_record(f"hand/{link}", T, FINGER_COLOURS[link_fingers[link]], link_fingers[link])
        for link, T in T_hand_link.items()
    ]
    for index, colour in enumerate(OBJECT_COLOURS):
        name = grasp[f"object{index}"]
        T = pose_matrix(grasp[f"position_hand_object{index}"], grasp[f"quaternion_hand_object{index}"])
        bodies.append(body_record(f"object/{name}", T, colour, name.replace("_", " ")))
    return {"merged_id": int(grasp["merged_id"]), "bodies": bodies}
