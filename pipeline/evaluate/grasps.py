"""The grasps that a sequence carries out, and which of them a trial tries in which order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.records.errors import UserError
from pipeline.records.poses import pose_matrix


@dataclass(frozen=True)
class PickGrasp:
    """How one object is grasped, in a hand that may hold others already."""

    fingers: tuple[str, ...]  # that belong to this object
    open_q: NDArray[np.float64]  # (16,) for the approach
    T_hand_object: NDArray[np.float64]  # (4, 4)
    approach_direction: NDArray[np.float64]  # (3,) object frame
    approach_length: float | None = None  # m; None: the settings' entry_length


class SequenceGrasp(Protocol):
    """One hand around its objects, picked one after the other."""

    @property
    def merged_id(self) -> int:
        """Row of the table that it comes from."""

    @property
    def q(self) -> NDArray[np.float64]:
        """(16,) joints at the end."""

    @property
    def squeeze_q(self) -> NDArray[np.float64]:
        """(16,) drive targets at the end."""

    @property
    def picks(self) -> tuple[PickGrasp, ...]:
        """One per object, in the order of picking."""


@dataclass(frozen=True)
class SeveralObjectsGrasp:
    """A grasp of any number of objects."""

    merged_id: int
    q: NDArray[np.float64]  # (16,)
    squeeze_q: NDArray[np.float64]  # (16,)
    picks: tuple[PickGrasp, ...]


@dataclass(frozen=True)
class TwoObjectGrasp:
    """One row of a merged table as arrays; hand frame and object frames as in ``records.tables``."""

    merged_id: int
    q: NDArray[np.float64]  # (16,)
    squeeze_q: NDArray[np.float64]  # (16,)
    open_q0: NDArray[np.float64]  # (16,)
    open_q1: NDArray[np.float64]  # (16,)
    T_hand_object0: NDArray[np.float64]  # (4, 4)
    T_hand_object1: NDArray[np.float64]  # (4, 4)
    approach_direction0: NDArray[np.float64]  # (3,) object 0 frame
    approach_direction1: NDArray[np.float64]  # (3,) object 1 frame
    approach_length1: float  # m

    @property
    def picks(self) -> tuple[PickGrasp, ...]:
        """The pinch, then the grasp with ring finger and palm."""
        return (
            PickGrasp(("thumb", "index", "middle"), self.open_q0, self.T_hand_object0, self.approach_direction0),
            PickGrasp(("ring",), self.open_q1, self.T_hand_object1, self.approach_direction1, self.approach_length1),
        )


def grasp_from_row(row: dict[str, Any]) -> TwoObjectGrasp:
    """Return the grasp in one row of a merged table.

    Raises:
        UserError: numbers are missing in it, or are not finite.
    """
    try:
        return _grasp_from_row(row)
    except (TypeError, ValueError) as error:
        raise UserError(
            f"grasp {row['merged_id']} of {row['object0']} then {row['object1']} is damaged ({error}); make or fetch "
            "its table again."
        ) from error


def _grasp_from_row(row: dict[str, Any]) -> TwoObjectGrasp:
    def array(name: str, length: int = 16) -> NDArray[np.float64]:
        values = np.asarray(row[name], dtype=np.float64)
        if values.shape != (length,) or not np.isfinite(values).all():
            raise ValueError(f"{name} is not {length} numbers")
        return values

    def pose(index: int) -> NDArray[np.float64]:
        quaternion = array(f"quaternion_hand_object{index}", 4)
        if not 0.99 < np.linalg.norm(quaternion) < 1.01:
            raise ValueError(f"quaternion_hand_object{index} is no rotation")
        return pose_matrix(array(f"position_hand_object{index}", 3), quaternion)

    return TwoObjectGrasp(
        merged_id=int(row["merged_id"]),
        q=array("q"),
        squeeze_q=array("squeeze_q"),
        open_q0=array("open_q0"),
        open_q1=array("open_q1"),
        T_hand_object0=pose(0),
        T_hand_object1=pose(1),
        approach_direction0=array("approach_direction0", 3),
        approach_direction1=array("approach_direction1", 3),
        approach_length1=float(row["approach_length1"]),
    )


def accepted_grasps(table: pd.DataFrame) -> list[TwoObjectGrasp]:
    """Return the grasps of a merged table that passed every check, the one with the most room first.

    Room: the smaller of both clearances, of the objects from each other and from links that do not hold them. It is
    known before any trial, and what is squeezed, carried and passed by touches less where there is more of it.
    """
    passed = table[table["rejected_by"] == ""].sort_values("merged_id", kind="stable")
    room = passed[["object_clearance", "hand_clearance"]].min(axis=1)
    passed = passed.iloc[np.argsort(-room.to_numpy(), kind="stable")]
    return [grasp_from_row({str(name): value for name, value in row.items()}) for row in passed.to_dict("records")]


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
