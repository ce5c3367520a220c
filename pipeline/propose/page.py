"""Two-object grasps as one HTML page that needs no network: the hand's collision shapes and both objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
import trimesh
from numpy.typing import NDArray

from pipeline.hand.kinematics import link_poses
from pipeline.hand.model import Hand
from pipeline.pictures.colours import OBJECT_COLOURS_HTML
from pipeline.pictures.decimation import Mesh, decimated
from pipeline.records.objects import PreparedObject
from pipeline.records.poses import pose_matrix, transform_points

HAND_COLOUR = "#9a9a9a"
TITLE = "Learned grasps, best first; hand frame, metres"

MOST_FACES = 1200  # of an object: the page repeats every shape for every grasp


def hand_mesh(q: NDArray[np.float64], hand: Hand) -> Mesh:
    """Return the collision shapes of the hand at ``q`` (J,) as one mesh, hand frame."""
    T = link_poses(hand, q[None])[0]
    parts = []
    for link, pose, half in zip(hand.box_link, hand.box_pose, hand.box_half, strict=True):
        parts.append(trimesh.creation.box(2 * half, T[link] @ pose))
    for link, centre, radius in zip(hand.sphere_link, hand.sphere_centre, hand.sphere_radius, strict=True):
        ball = trimesh.creation.icosphere(1, radius)
        parts.append(ball.apply_translation(transform_points(T[link], centre[None])[0]))
    joined: Any = trimesh.util.concatenate(parts)
    return np.asarray(joined.vertices), np.asarray(joined.faces)


def grasp_page(rows: Sequence[Mapping[str, Any]], objects: tuple[PreparedObject, PreparedObject], hand: Hand) -> str:
    """Return the page; ``rows`` are of a merged table, in the frames of ``objects``."""
    shapes = [decimated((prepared.vertices, prepared.faces), MOST_FACES) for prepared in objects]
    figure = go.Figure()
    for index, row in enumerate(rows):
        meshes: list[tuple[Mesh, str, str]] = [(hand_mesh(np.asarray(row["q"], np.float64), hand), HAND_COLOUR, "hand")]
        for slot, prepared in enumerate(objects):
            T = pose_matrix(row[f"position_hand_object{slot}"], row[f"quaternion_hand_object{slot}"])
            vertices, faces = shapes[slot]
            meshes.append(((transform_points(T, vertices), faces), OBJECT_COLOURS_HTML[slot], prepared.name))
        for (vertices, faces), colour, name in meshes:
            x, y, z = np.round(vertices, 5).T
            i, j, k = faces.T
            figure.add_trace(
                go.Mesh3d(x=x, y=y, z=z, i=i, j=j, k=k, color=colour, name=name, visible=index == 0, flatshading=True)
            )
    buttons = [
        {
            "label": f"grasp {index + 1}",
            "method": "update",
            "args": [{"visible": [trace // 3 == index for trace in range(3 * len(rows))]}],
        }
        for index in range(len(rows))
    ]
    figure.update_layout(title=TITLE, scene={"aspectmode": "data"}, updatemenus=[{"buttons": buttons}])
    page: str = figure.to_html(include_plotlyjs=True, config={"displaylogo": False})
    return page
