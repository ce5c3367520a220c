"""Single grasps as they come from validation, and the joining of several of them into one hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.hand.model import Hand
from pipeline.hand.moves import finger_joints, straight
from pipeline.hand.parts import joined_points
from pipeline.records.parameters.hand import PALM
from pipeline.records.poses import inverse_pose, pose_matrix, transform_points

# Which parts of the hand belong to which object, in the order of picking. Fingers belong to one object; the palm may
# press on several.
Groups = tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class SingleGrasp:
    """One validated grasp of one object; SI units, joint order of the hand."""

    grasp_id: int
    fingers: tuple[str, ...]
    T_object_hand: NDArray[np.float64]  # (4, 4)
    contact_candidates: NDArray[np.int64]  # (n,) indices into Hand.contact_points
    q: NDArray[np.float64]  # (J,)
    squeeze_q: NDArray[np.float64]  # (J,)
    open_q: NDArray[np.float64]  # (J,)
    approach_direction: NDArray[np.float64]  # (3,) object frame, unit, towards where the hand comes from


@dataclass(frozen=True)
class JoinedGrasp:
    """One hand around its objects, which are in the order of picking; two of them are the usual case."""

    hand: Hand
    singles: tuple[SingleGrasp, ...]
    groups: Groups  # per object the parts of the hand that belong to it; its grasp may use less
    q: NDArray[np.float64]  # (J,)
    squeeze_q: NDArray[np.float64]  # (J,)
    T_hand_object: tuple[NDArray[np.float64], ...]  # (4, 4) each
    held_q: NDArray[np.float64]  # (J,) like q, but the fingers of all but the last as they are once they squeeze
    T_hand_held: tuple[NDArray[np.float64], ...]  # (4, 4) of the objects then; see pipeline.physics.settling

    def posture(self, pick: int) -> NDArray[np.float64]:
        """Return joints (J,), rad, when number ``pick`` was just grasped: as held, but waiting fingers straight."""
        q, waiting = self.held_q.copy(), fingers_of(self.groups[pick + 1 :])
        q[finger_joints(waiting, self.hand)] = straight(waiting, self.hand)
        return q


def fingers_of(groups: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """Return the fingers of some groups, the palm left out."""
    return tuple(finger for group in groups for finger in group if finger != PALM)


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


def distinct_grasps(
    hand: Hand, grasps: list[SingleGrasp], groups: Groups, number: int, distance: float
) -> list[SingleGrasp]:
    """Return the grasps of one object without those that nearly repeat an earlier one.

    Args:
        groups, number: parts of the hand for every object, and which one is grasped here.
        distance: m; two grasps are one when the parts of the hand that count lie closer than this on average.
    """
    if not grasps:
        return []
    others = fingers_of([group for place, group in enumerate(groups) if place != number])
    shapes = np.stack(
        [
            transform_points(grasp.T_object_hand, joined_points(groups[number], others, grasp.q, hand))
            for grasp in grasps
        ]
    )
    kept: list[int] = []
    for index, shape in enumerate(shapes):
        apart = np.linalg.norm(shapes[kept] - shape, axis=2).mean(1)
        if (apart >= distance).all():
            kept.append(index)
    return [grasps[index] for index in kept]


def join(hand: Hand, singles: Sequence[SingleGrasp], groups: Groups) -> JoinedGrasp:
    """Join grasps: the fingers of each group as in its grasp, all others as in the first one, each object where its
    grasp has it. Objects are taken to stay where they are when they are squeezed.
    """
    T_hand_object = tuple(inverse_pose(single.T_object_hand) for single in singles)
    q, squeeze_q = singles[0].q.copy(), singles[0].squeeze_q.copy()
    for single, group in zip(singles[1:], groups[1:], strict=True):
        own = finger_joints(group, hand)
        q[own] = single.q[own]
        squeeze_q[own] = single.squeeze_q[own]
    return JoinedGrasp(hand, tuple(singles), groups, q, squeeze_q, T_hand_object, q, T_hand_object)


def fingers_fit(singles: Sequence[SingleGrasp], groups: Groups) -> bool:
    """Whether every grasp uses parts of its group alone, at least two of them, and no finger is in two groups."""
    fingers = fingers_of(groups)
    return len(set(fingers)) == len(fingers) and all(
        set(single.fingers) <= set(group) and len(set(single.fingers)) >= 2
        for single, group in zip(singles, groups, strict=True)
    )
