"""The grasps that a sequence carries out, and which of them a trial tries in which order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.hand.model import Hand
from pipeline.hand.moves import finger_joints
from pipeline.records.errors import UserError
from pipeline.records.poses import pose_matrix


@dataclass(frozen=True)
class PickGrasp:
    """How one object is grasped, in a hand that may hold others already."""

    joints: NDArray[np.int64]  # (k,) of the fingers that belong to this object
    open_q: NDArray[np.float64]  # (J,) for the approach
    T_hand_object: NDArray[np.float64]  # (4, 4)
    approach_direction: NDArray[np.float64]  # (3,) object frame
    approach_length: float | None = None  # m; None: the settings' entry_length


@dataclass(frozen=True)
class SequenceGrasp:
    """One hand around its objects, picked one after the other: a row of a merged table as arrays."""

    merged_id: int
    q: NDArray[np.float64]  # (J,) joints at the end
    squeeze_q: NDArray[np.float64]  # (J,) drive targets at the end
    picks: tuple[PickGrasp, ...]  # in the order of picking


def grasp_from_row(row: dict[str, Any], hand: Hand, groups: Sequence[Sequence[str]]) -> SequenceGrasp:
    """Return the grasp in one accepted row of a merged table.

    Args:
        groups: parts of the hand that belong to each object.

    Raises:
        UserError: numbers are missing in it, or are not finite, or it is of another number of objects.
    """
    try:
        return _grasp_from_row(row, hand, groups)
    except (TypeError, ValueError, IndexError) as error:
        raise UserError(
            f"grasp {row['merged_id']} of {' then '.join(row['objects'])} is damaged ({error}); make or fetch "
            "its table again."
        ) from error


def _grasp_from_row(row: dict[str, Any], hand: Hand, groups: Sequence[Sequence[str]]) -> SequenceGrasp:
    def array(name: str, values: Any, length: int) -> NDArray[np.float64]:
        found = np.asarray(values, dtype=np.float64)
        if found.shape != (length,) or not np.isfinite(found).all():
            raise ValueError(f"{name} is not {length} numbers")
        return found

    def part(name: str, number: int, length: int) -> NDArray[np.float64]:
        return array(f"{name} of object {number}", row[name][number], length)

    def pose(number: int) -> NDArray[np.float64]:
        quaternion = part("quaternions_hand_object", number, 4)
        if not 0.99 < np.linalg.norm(quaternion) < 1.01:
            raise ValueError(f"quaternions_hand_object of object {number} is no rotation")
        return pose_matrix(part("positions_hand_object", number, 3), quaternion)

    if len(row["objects"]) != len(groups):
        raise ValueError(f"{len(row['objects'])} objects, where a sequence has {len(groups)}")
    return SequenceGrasp(
        merged_id=int(row["merged_id"]),
        q=array("q", row["q"], hand.joint_count),
        squeeze_q=array("squeeze_q", row["squeeze_q"], hand.joint_count),
        picks=tuple(
            PickGrasp(
                joints=finger_joints(group, hand),
                open_q=part("open_q", number, hand.joint_count),
                T_hand_object=pose(number),
                approach_direction=part("approach_directions", number, 3),
                approach_length=float(row["approach_lengths"][number]) if number else None,
            )
            for number, group in enumerate(groups)
        ),
    )


def accepted_grasps(
    table: pd.DataFrame, hand: Hand, groups: Sequence[Sequence[str]], least_room: float
) -> list[SequenceGrasp]:
    """Return the grasps of a merged table that passed every check, the preferred first; see :func:`preference`."""
    passed = table[table["rejected_by"] == ""].sort_values("merged_id", kind="stable")
    passed = passed.iloc[preference(passed, least_room)]
    rows = ({str(name): value for name, value in row.items()} for row in passed.to_dict("records"))
    return [grasp_from_row(row, hand, groups) for row in rows]


def preference(passed: pd.DataFrame, least_room: float) -> NDArray[np.int64]:
    """Return the order (n,) in which accepted grasps of a merged table are preferred, from what was known of them.

    Those with enough room come first: of them, and of the others, those that hold at the lowest friction, then those
    that survive most of the drawn conditions, then those with the most room. What was not measured counts as worst.

    Args:
        least_room: what is enough, m. Room is the smaller of both clearances, of the objects from each other and from
            links that do not hold them: what is squeezed, carried and passed by touches less where there is more of it.
    """
    room = passed[["object_clearance", "hand_clearance"]].min(axis=1).to_numpy(np.float64)
    survived = passed["robustness"].astype(np.float64).fillna(0.0).to_numpy()
    friction = passed["lowest_friction"].astype(np.float64).fillna(np.inf).to_numpy()
    return np.lexsort((-room, -survived, friction, room < least_room))


def grasp_orders(count: int, trials: int, attempts: int, rng: np.random.Generator) -> list[NDArray[np.int64]]:
    """Return for each trial the indices of the grasps to try, in order, at most ``attempts`` of ``count``.

    The first choices of successive trials run through one random permutation of the first ``trials`` grasps, so they
    differ as long as there are enough; the others, used when no motion is found for the first, are random.
    """
    first = rng.permutation(min(count, trials))
    orders = []
    for trial in range(trials):
        others = rng.permutation(count)
        chosen = first[trial % count] if count else 0
        orders.append(np.concatenate([[chosen], others[others != chosen]])[: min(attempts, count)].astype(np.int64))
    return orders
