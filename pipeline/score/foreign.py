"""Grasps as a file from outside has them, before they are brought into our frames and joint order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.records.errors import UserError
from pipeline.records.poses import pose_matrix

MOST_GRASPS = 100_000  # in one file


@dataclass(frozen=True)
class Hold:
    """How one object lies in the hand."""

    T_object_hand: NDArray[np.float64]  # (4, 4) root link of the hand in the frame of the object's mesh, m
    fingers: tuple[str, ...] = ()  # that hold it, as the file says; empty: it does not say
    contacts: tuple[int, ...] = ()  # contact points counted through the links, as SeqMultiGrasp does; likewise


@dataclass(frozen=True)
class ForeignGrasp:
    """One grasp of one object, or of two in the order of picking."""

    holds: tuple[Hold, ...]
    joints: NDArray[np.float64]  # (V,) rad, in the order of the file
    squeeze: NDArray[np.float64] | None = None  # (V,) rad, drive targets that press; None: the file has none
    scale: float = 1.0  # of the object's mesh


@dataclass(frozen=True)
class ForeignFile:
    """What a file holds, and how it was understood."""

    source: Path
    form: str  # name of its format, for people
    grasps: tuple[ForeignGrasp, ...]
    joint_names: tuple[str, ...] | None  # (V,) None: the file names none
    y_up: bool = False  # poses are of the released y-up meshes
    understood: tuple[str, ...] = field(default=())  # what was taken for granted, in sentences


def numbers(content: Any, shape: tuple[int | None, ...], what: str, source: Path) -> NDArray[np.float64]:
    """Return finite numbers of a shape, in which None stands for any length.

    Raises:
        UserError: they are anything else.
    """
    try:
        array = np.asarray(content, np.float64)
    except (TypeError, ValueError) as error:
        raise UserError(f"{source}: {what} is not made of numbers; correct it there.") from error
    wanted = " x ".join("any" if length is None else str(length) for length in shape) or "one number"
    if array.ndim != len(shape) or any(want not in (None, got) for got, want in zip(array.shape, shape, strict=True)):
        raise UserError(f"{source}: {what} has the shape {array.shape}, not {wanted}; correct it there.")
    if not np.isfinite(array).all():
        raise UserError(f"{source}: {what} has a value that is not a number (NaN or infinite); correct it there.")
    return array


def proper_poses(T: Any, what: str, source: Path) -> NDArray[np.float64]:
    """Return rigid transforms (n, 4, 4).

    Raises:
        UserError: they are transposed, scaled, skewed, mirrored or of another shape.
    """
    poses = numbers(T, (None, 4, 4), what, source)
    if np.abs(poses[:, 3] - [0, 0, 0, 1]).max(initial=0) > 1e-6:
        mend = "transpose it" if np.abs(poses[:, :, 3] - [0, 0, 0, 1]).max() <= 1e-6 else "correct it there"
        raise UserError(f"{source}: the last row of {what} is not 0, 0, 0, 1; {mend}.")
    R = poses[:, :3, :3]
    if np.abs(R @ R.swapaxes(1, 2) - np.eye(3)).max(initial=0) > 1e-3 or (np.linalg.det(R) < 0).any():
        raise UserError(f"{source}: {what} is not a rotation with a translation; correct it there.")
    return poses


def from_quaternions(
    positions: NDArray[np.float64], quaternions: NDArray[np.float64], order: str, source: Path
) -> NDArray[np.float64]:
    """Return poses (n, 4, 4) of positions (n, 3), m, and quaternions (n, 4) in the order `wxyz` or `xyzw`.

    Raises:
        UserError: a quaternion is not of unit length.
    """
    length = np.linalg.norm(quaternions, axis=1)
    if np.abs(length - 1).max(initial=0) > 0.02:
        worst = int(np.abs(length - 1).argmax())
        raise UserError(
            f"{source}: the quaternion of grasp {worst} has the length {length[worst]:.3g}, not 1; correct it."
        )
    return pose_matrix(positions, quaternions if order == "wxyz" else np.roll(quaternions, 1, axis=1))


def from_fixed_angles(positions: NDArray[np.float64], angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return poses (n, 4, 4) of positions (n, 3), m, and angles (n, 3), rad, about the fixed axes x, y, z."""
    from scipy.spatial.transform import Rotation

    T = np.tile(np.eye(4), (len(positions), 1, 1))
    T[:, :3, :3] = Rotation.from_euler("xyz", angles).as_matrix()
    T[:, :3, 3] = positions
    return T


def from_six(positions: NDArray[np.float64], six: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return poses (n, 4, 4) of positions (n, 3), m, and the first two columns of rotations (n, 6), in a row.

    Columns that are no unit vectors at right angles, as an optimiser leaves them, are brought there as in DexGraspNet:
    each by as much. Where instead the two columns taken in turns are, that is how they were written.
    """
    first, second = six[:, :3], six[:, 3:]
    if not _orthonormal(first, second) and _orthonormal(six[:, ::2], six[:, 1::2]):
        first, second = six[:, ::2], six[:, 1::2]
    x, y = (axis / np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-12) for axis in (first, second))
    between, across = (axis / np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-12) for axis in (x + y, x - y))
    x, y = (between + across) / np.sqrt(2), (between - across) / np.sqrt(2)
    T = np.tile(np.eye(4), (len(positions), 1, 1))
    T[:, :3, :3] = np.stack([x, y, np.cross(x, y)], axis=2)
    T[:, :3, 3] = positions
    return T


def _orthonormal(x: NDArray[np.float64], y: NDArray[np.float64]) -> bool:
    off = [(x * x).sum(axis=1) - 1, (y * y).sum(axis=1) - 1, (x * y).sum(axis=1)]
    return bool(np.abs(off).max(initial=0) < 1e-3)


def check_count(count: int, source: Path) -> None:
    """Refuse a file without grasps, or with more than can be meant.

    Raises:
        UserError: it is one.
    """
    if not 0 < count <= MOST_GRASPS:
        raise UserError(f"{source} holds {count} grasps; give between 1 and {MOST_GRASPS} in a file.")


def entry(record: Any, name: str, source: Path) -> Any:
    """Return an entry of a dictionary.

    Raises:
        UserError: it has none of this name.
    """
    if not isinstance(record, dict) or name not in record:
        known = ", ".join(map(str, list(record)[:12])) if isinstance(record, dict) else type(record).__name__
        raise UserError(f"{source} has no {name!r} where a grasp should have it (there: {known}); see docs/lab.md.")
    return record[name]


def texts(content: Sequence[Any]) -> tuple[str, ...]:
    """Return names as texts, whatever kind of text they are."""
    return tuple(item.decode("utf-8", "replace") if isinstance(item, bytes) else str(item) for item in content)
