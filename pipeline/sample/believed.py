"""Samples for what one camera's view makes believe of objects, carried over to the frames of the objects themselves.

How what is believed lies to the truth follows from where the camera stood when it saw the object: errors of shape and
pose stay errors, and nothing is fitted to make them smaller.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.model.completion import belief_of, believed_object
from pipeline.model.representation import in_frames
from pipeline.records.objects import PreparedObject
from pipeline.records.poses import inverse_pose, pose_matrix, position_quaternion
from pipeline.sample.proposals import Drawn
from pipeline.stages.seeds import item_generator


def believed(
    seed: int, seen: tuple[int, PreparedObject]
) -> tuple[PreparedObject, NDArray[np.float64], NDArray[np.float64]]:
    """Return an object as one view shows it, the points (n, 3) of the view, and ``T_object_belief`` (4, 4).

    Args:
        seed: of the pair.
        seen: the place of the object in the pair, and the object.

    Raises:
        UserError: see :func:`pipeline.model.views.view_of`.
    """
    slot, item = seen
    belief = belief_of(item, item_generator(seed, "sample", "view", slot))
    return believed_object(item.name, belief), belief.points, belief.T_object_belief


def table_in_frames(table: pd.DataFrame, T_object_belief: Sequence[NDArray[np.float64]]) -> pd.DataFrame:
    """Return a table ``MERGED``, given in the frames of what is believed, in those of the objects.

    Args:
        T_object_belief: (4, 4) of each object.
    """
    if table.empty:
        return table
    poses = pose_matrix(
        np.array([np.stack(own) for own in table["positions_hand_object"]]),
        np.array([np.stack(own) for own in table["quaternions_hand_object"]]),
    )
    positions, quaternions = position_quaternion(poses @ inverse_pose(np.stack(T_object_belief)))
    ways = [
        [T[:3, :3] @ np.asarray(way) for T, way in zip(T_object_belief, own, strict=False)]
        for own in table["approach_directions"]
    ]
    return table.assign(
        positions_hand_object=[list(own) for own in positions],
        quaternions_hand_object=[list(own) for own in quaternions],
        approach_directions=ways,
    )


def drawn_in_frames(drawn: Drawn, T_object_belief: Sequence[NDArray[np.float64]]) -> Drawn:
    """Return samples, given in the frames of what is believed, in those of the objects."""
    back = inverse_pose(np.stack(T_object_belief))
    raw, ranked = (replace(scored, grasps=in_frames(scored.grasps, back)) for scored in (drawn.raw, drawn.ranked))
    return replace(drawn, raw=raw, ranked=ranked)
