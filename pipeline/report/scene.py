"""Geometry of merged grasps for the interactive views: every shape is stored once, every grasp places it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.pictures.colours import OBJECT_COLOURS_HTML
from pipeline.pictures.decimation import Mesh
from pipeline.records.poses import pose_matrix
from pipeline.report.trial_rows import scaled

UNIT = 1e-4  # m; vertices are stored as whole multiples of it
MOST_FACES = 1200  # of an object
MOST_LINK_FACES = 350
GRASPS_PER_PAIR = 6


def shape_record(mesh: Mesh) -> dict[str, list[int]]:
    """Return the mesh as flat lists of whole numbers: vertices in multiples of ``UNIT``, faces as vertex indices."""
    vertices, faces = mesh
    return {
        "vertices": np.rint(vertices / UNIT).astype(int).ravel().tolist(),
        "faces": faces.astype(int).ravel().tolist(),
    }


def body_record(shape: str, T_hand_body: NDArray[np.float64], colour: str, name: str) -> dict[str, Any]:
    """Return one placed shape; the pose is the upper three rows of ``T_hand_body`` (4, 4)."""
    pose = [round(float(value), 5) + 0.0 for value in T_hand_body[:3].ravel()]
    return {"shape": shape, "pose": pose, "colour": colour, "name": name}


def shown_grasps(merged: pd.DataFrame, preferred: Sequence[int], most: int = GRASPS_PER_PAIR) -> pd.DataFrame:
    """Return accepted grasps to show: the ``preferred`` merged ids first (as the robot used them), then by id."""
    accepted = merged[merged["rejected_by"] == ""].sort_values("merged_id")
    rank = {merged_id: index for index, merged_id in enumerate(dict.fromkeys(preferred))}
    order = accepted["merged_id"].map(lambda merged_id: rank.get(merged_id, len(rank)))
    return accepted.assign(_order=order).sort_values(["_order", "merged_id"]).head(most).drop(columns="_order")


GRASP_HEADERS = (
    "merged grasp",
    "first: grasp, fingers",
    "second: grasp, fingers",
    "first in the hand: x, y, z (mm)",
    "w, x, y, z",
    "second in the hand: x, y, z (mm)",
    "w, x, y, z",
    "between the objects (mm)",
    "joints (rad)",
)


def grasp_row(grasp: Mapping[str, Any]) -> list[str]:
    """Return the numbers of one merged grasp (a row of a merged table) under ``GRASP_HEADERS``."""

    def joined(values: Any, factor: float, digits: int) -> str:
        return ", ".join(scaled(value, factor, digits) for value in values)

    poses = [
        cell
        for index in (0, 1)
        for cell in (
            joined(grasp[f"position_hand_object{index}"], 1000.0, 2),
            joined(grasp[f"quaternion_hand_object{index}"], 1.0, 4),
        )
    ]
    halves = [f"{grasp[f'grasp{index}_id']}, {grasp[f'fingers{index}']}" for index in (0, 1)]
    clearance = scaled(grasp["object_clearance"], 1000.0, 2)
    return [str(grasp["merged_id"]), *halves, *poses, clearance, joined(grasp["q"], 1.0, 3)]


def grasp_record(grasp: Mapping[str, Any], links: Sequence[tuple[str, NDArray[np.float64], str]]) -> dict[str, Any]:
    """Return one merged grasp: the hand's links and both objects, placed in the hand frame.

    Args:
        grasp: a row of a merged table.
        links: shape, ``T_hand_link`` (4, 4) and colour of every drawn part of the hand.
    """
    bodies = [body_record(shape, T, colour, "hand") for shape, T, colour in links]
    for index, colour in enumerate(OBJECT_COLOURS_HTML[:2]):
        name = grasp[f"object{index}"]
        bodies.append(body_record(f"object/{name}", object_pose(grasp, index), colour, name.replace("_", " ")))
    return {"merged_id": int(grasp["merged_id"]), "bodies": bodies}


def object_pose(grasp: Mapping[str, Any], index: int) -> NDArray[np.float64]:
    """Return ``T_hand_object`` (4, 4) of the first (0) or second (1) object of a merged grasp."""
    return pose_matrix(grasp[f"position_hand_object{index}"], grasp[f"quaternion_hand_object{index}"])
