"""Single grasps as they come from validation, and the joining of two of them into one hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.hand.moves import RING_JOINTS
from pipeline.hand.parts import part_points
from pipeline.records.poses import inverse_pose, pose_matrix, transform_points


@dataclass(frozen=True)
class SingleGrasp:
    """One validated grasp of one object; SI units, joint order of ``JOINT_NAMES``."""

    grasp_id: int
    fingers: tuple[str, ...]
    T_object_hand: NDArray[np.float64]  # (4, 4)
    contact_candidates: NDArray[np.int64]  # (n,) indices into Hand.contact_points
    q: NDArray[np.float64]  # (16,)
    squeeze_q: NDArray[np.float64]  # (16,)
    open_q: NDArray[np.float64]  # (16,)
    approach_direction: NDArray[np.float64]  # (3,) object frame, unit, towards where the hand comes from


@dataclass(frozen=True)
class MergedGrasp:
    """One hand around two objects: ``first`` is pinched, ``second`` is held by ring and palm."""

    first: SingleGrasp
    second: SingleGrasp
    q: NDArray[np.float64]  # (16,)
    squeeze_q: NDArray[np.float64]  # (16,)
    T_hand_object0: NDArray[np.float64]  # (4, 4)
    T_hand_object1: NDArray[np.float64]  # (4, 4)
    held_q: NDArray[np.float64]  # (16,) like q, but the pinching fingers as they are once they squeeze
    T_hand_held0: NDArray[np.float64]  # (4, 4) of object 0 then; see pipeline.physics.settling


def validated_grasps(table: pd.DataFrame) -> list[SingleGrasp]:
    """Return the grasps of a validated table that passed every check, in order of ``grasp_id``."""
    passed = table[table["rejected_by"] == ""].sort_values("grasp_id")
    return [
        SingleGrasp(
            grasp_id=int(row.grasp_id),
            fingers=tuple(row.fingers.split("+")),
            T_object_hand=pose_matrix(row.position_object_hand, row.quaternion_object_hand),
            contact_candidates=np.array(row.contact_candidates, np.int64),
            q=np.array(row.q, np.float64),
            squeeze_q=np.array(row.squeeze_q, np.float64),
            open_q=np.array(row.open_q, np.float64),
            approach_direction=np.array(row.approach_direction, np.float64),
        )
        for row in passed.itertuples()
    ]


def _shape(grasp: SingleGrasp) -> NDArray[np.float64]:
    """Surface points (n, 3), object frame, of the part of the hand that a merged grasp takes from this one."""
    style = "side" if "ring" in grasp.fingers else "pinch"
    return transform_points(grasp.T_object_hand, part_points(style, grasp.q))


def distinct_grasps(grasps: list[SingleGrasp], distance: float) -> list[SingleGrasp]:
    """Return the grasps, all of one style, without those that nearly repeat an earlier one.

    Args:
        distance: m; two grasps are one when the parts of the hand that count lie closer than this on average.
    """
    if not grasps:
        return []
    shapes = np.stack([_shape(grasp) for grasp in grasps])
    kept: list[int] = []
    for index, shape in enumerate(shapes):
        apart = np.linalg.norm(shapes[kept] - shape, axis=2).mean(1)
        if (apart >= distance).all():
            kept.append(index)
    return [grasps[index] for index in kept]


def join(first: SingleGrasp, second: SingleGrasp) -> MergedGrasp:
    """Join two grasps: thumb, index and middle as in ``first``, ring as in ``second``, each object where its grasp
    has it. Object 0 is taken to stay where it is when it is squeezed.
    """
    T_hand_object0 = inverse_pose(first.T_object_hand)
    q, squeeze_q = first.q.copy(), first.squeeze_q.copy()
    q[RING_JOINTS] = second.q[RING_JOINTS]
    squeeze_q[RING_JOINTS] = second.squeeze_q[RING_JOINTS]
    return MergedGrasp(
        first=first,
        second=second,
        q=q,
        squeeze_q=squeeze_q,
        T_hand_object0=T_hand_object0,
        T_hand_object1=inverse_pose(second.T_object_hand),
        held_q=q,
        T_hand_held0=T_hand_object0,
    )


def fingers_are_disjoint(first: SingleGrasp, second: SingleGrasp) -> bool:
    """Whether ``first`` uses only thumb, index and middle, at least two of them, and ``second`` only ring and palm."""
    return (
        set(first.fingers) <= {"thumb", "index", "middle"}
        and len(set(first.fingers)) >= 2
        and set(second.fingers) == {"ring", "palm"}
    )
