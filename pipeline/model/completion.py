"""A closed surface made from one camera's view alone, and the frame in which the robot believes an object to be.

The completed solid is the convex hull of four things: what is seen; its mirror image in the vertical plane through the
object's middle that faces the camera, but for points where the camera sees through to something farther; what is seen
just over the table, continued down to it; and one point of the table under the middle, as the object stands somewhere.
The middle is where the object would be as deep as it is wide, or nearer if the camera sees through that mirror image.

Frame of what is believed: upright, origin at the completed solid's centre of mass, x towards the camera.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pipeline.model.views import EDGE, TABLE, View, pixels, view_of
from pipeline.records.objects import PreparedObject
from pipeline.records.poses import inverse_pose, transform_points

if TYPE_CHECKING:
    import trimesh

MIDDLES = 9  # places of the middle that are tried
HIDDEN = 0.97  # share of the mirror image that the camera must not see through
FOOT = 0.008  # m over the cut at the table: what is seen there is taken to go on downwards


@dataclass(frozen=True)
class Belief:
    """An object as one view shows it, in the frame of what is believed."""

    points: NDArray[np.float64]  # (n, 3) that are seen, m
    solid: trimesh.Trimesh  # closed, its centre of mass at the origin
    T_object_belief: NDArray[np.float64]  # (4, 4) to the true object's frame, which the robot does not know


def completed(view: View) -> trimesh.Trimesh:
    """Return the closed surface that a view and the table allow, table frame."""
    import trimesh

    points = view.points
    x, y = points[:, 0], points[:, 1]
    nearest = (x.min() + x.max()) / 2
    farthest = min(nearest, x.max() - np.ptp(y) / 2)
    for middle in np.linspace(farthest, nearest, MIDDLES):
        mirrored = points * [-1, 1, 1] + [2 * middle, 0, 0]
        covered = hidden(view, mirrored)
        if covered.mean() >= HIDDEN:
            break
    both = np.concatenate([points, mirrored[covered]])
    foot = both[both[:, 2] < TABLE + FOOT] * [1, 1, 0]
    standing = np.array([[middle, (y.min() + y.max()) / 2, 0.0]])
    return trimesh.convex.convex_hull(np.concatenate([both, foot, standing]))


def hidden(view: View, points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which points (n, 3), table frame, may be solid: the camera does not see through them."""
    local = transform_points(inverse_pose(view.T_table_camera), points)
    row, column = pixels(local).T
    height, width = view.depth.shape
    inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    measured = view.depth[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]
    return inside & ~(local[:, 2] < measured - EDGE)


def belief_of(prepared: PreparedObject, rng: np.random.Generator) -> Belief:
    """Return what one camera at a random place makes believe of an object.

    Raises:
        UserError: see :func:`pipeline.model.views.view_of`.
    """
    view = view_of(prepared, rng)
    solid = completed(view)
    centre = np.asarray(solid.center_mass, np.float64)
    solid.apply_translation(-centre)
    T_table_belief = np.eye(4)
    T_table_belief[:3, 3] = centre
    return Belief(view.points - centre, solid, inverse_pose(view.T_table_object) @ T_table_belief)


def believed_object(name: str, belief: Belief) -> PreparedObject:
    """Return the completed solid as an object: what refinement, ranking and physics are given in place of the truth."""
    from pipeline.shapes.solids import object_of_solid

    return object_of_solid(name, belief.solid)
