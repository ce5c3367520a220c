"""Files of grasps in the formats that other projects publish; docs/lab.md lists them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.records.errors import UserError
from pipeline.records.poses import inverse_pose, pose_matrix
from pipeline.score.foreign import (
    ForeignFile,
    ForeignGrasp,
    Hold,
    check_count,
    entry,
    from_fixed_angles,
    from_quaternions,
    from_six,
    numbers,
    proper_poses,
    texts,
)
from pipeline.score.own_format import read_csv, read_json
from pipeline.score.unpickled import read_npy

JOINTS = ("joints", "q", "qpos")  # how joint angles beside a pose are called
WRIST = ("WRJTx", "WRJTy", "WRJTz", "WRJRx", "WRJRy", "WRJRz")
# DexGraspBench's Allegro (MuJoCo's menagerie) turns the root link so under its own root: T_benchroot_root.
BENCH_PALM = pose_matrix((0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 1.0))
# FRoGGeR's hand is placed by its palm; the root link of ours lies so in it (m along z).
FROGGER_PALM = 0.095
FROGGER_JOINTS = tuple(
    f"algr_rh_{finger}_{joint}"
    for finger, own in (
        *((name, ("axl", "mcp", "pip", "dip")) for name in ("if", "mf", "rf")),
        ("th", ("cmc", "axl", "mcp", "ipl")),
    )
    for joint in own
)


def read_grasps(source: Path, quaternions: str) -> ForeignFile:
    """Read a file, or a folder of npy files with a grasp each.

    Args:
        quaternions: `wxyz` or `xyzw`, the order in formats that have quaternions.

    Raises:
        UserError: it is missing, damaged or of no known format.
    """
    if source.is_dir():
        return _folder(source, quaternions)
    if not source.is_file():
        raise UserError(f"{source} is missing; name a file of grasps.")
    reader = READERS.get(source.suffix.lower())
    if reader is None:
        raise UserError(f"{source} has none of the endings {', '.join(READERS)}; convert it, see docs/lab.md.")
    found = reader(source, quaternions)
    check_count(len(found.grasps), source)
    return found


def _folder(folder: Path, quaternions: str) -> ForeignFile:
    files = sorted(folder.glob("*.npy"), key=lambda file: (len(file.name), file.name))
    check_count(len(files), folder)
    parts = [read_npy_grasps(file, quaternions) for file in files]
    first = parts[0]
    if any((part.form, part.joint_names) != (first.form, first.joint_names) for part in parts):
        raise UserError(f"{folder} holds files of several formats or joint orders; give one folder for each.")
    grasps = tuple(grasp for part in parts for grasp in part.grasps)
    return ForeignFile(folder, first.form, grasps, first.joint_names, first.y_up, first.understood)


def read_npy_grasps(source: Path, quaternions: str) -> ForeignFile:
    """Read DexGraspNet's lists of dictionaries, or BODex's and DexGraspBench's dictionaries of arrays."""
    content = read_npy(source)
    if isinstance(content, dict):
        return read_dictionary(content, source, quaternions)
    if isinstance(content, list) and content and isinstance(content[0], dict):
        if "grasp_qpos" in content[0]:
            parts = [read_dictionary(record, source, quaternions) for record in content]
            grasps = tuple(grasp for part in parts for grasp in part.grasps)
            return ForeignFile(source, parts[0].form, grasps, parts[0].joint_names, False, parts[0].understood)
        return read_dexgraspnet(content, source)
    raise UserError(
        f"{source} holds an array that says neither where hand nor joints are; write npz, JSON or CSV, see docs/lab.md."
    )


def read_dictionary(content: dict[Any, Any], source: Path, quaternions: str) -> ForeignFile:
    """Read a dictionary of arrays by what it has: BODex's raw or DexGraspBench's, or FRoGGeR's ``q_star``."""
    for name, reader in (("robot_pose", read_bodex), ("grasp_qpos", read_bench), ("q_star", read_frogger)):
        if name in content:
            return reader(content, source, quaternions)
    if "hand_pose" in content:
        return read_hand_pose(content, source)
    for name in JOINTS:
        if name in content:
            return read_arrays(content | {"joints": content[name]}, source, quaternions)
    raise UserError(
        f"{source} has none of robot_pose (BODex), grasp_qpos (DexGraspBench), q_star (FRoGGeR), hand_pose "
        f"(DexGraspNet) and {' or '.join(JOINTS)}; see docs/lab.md."
    )


def read_dexgraspnet(records: list[Any], source: Path) -> ForeignFile:
    """Read DexGraspNet's grasps, or SeqMultiGrasp's before they are merged: a dictionary each, angles of fixed axes."""
    names = tuple(name for name in entry(records[0], "qpos", source) if name not in WRIST)
    grasps = []
    for index, record in enumerate(records):
        qpos = entry(record, "qpos", source)
        wrist = numbers([entry(qpos, name, source) for name in WRIST], (6,), f"the wrist of grasp {index}", source)
        joints = numbers([entry(qpos, name, source) for name in names], (None,), f"qpos of grasp {index}", source)
        T = from_fixed_angles(wrist[None, :3], wrist[None, 3:])[0]
        contacts = tuple(int(point) for point in record.get("contact_point_indices", ()))
        scale = float(numbers(record.get("scale", 1.0), (), "scale", source))
        grasps.append(ForeignGrasp((Hold(T, contacts=contacts),), joints, scale=scale))
    return ForeignFile(
        source,
        "DexGraspNet (npy)",
        tuple(grasps),
        texts(names),
        understood=(
            "Poses are of the hand's root link in the frame of the scaled mesh; angles turn about fixed axes.",
        ),
    )


def read_hand_pose(content: dict[Any, Any], source: Path) -> ForeignFile:
    """Read what DexGraspNet optimises: ``hand_pose`` (n, 9 + V) of position, two columns of the rotation, joints."""
    values = numbers(np.atleast_2d(np.asarray(content["hand_pose"])), (None, None), "hand_pose", source)
    if values.shape[1] < 10:
        raise UserError(f"{source}: hand_pose has {values.shape[1]} values; it needs a pose (9) and joints.")
    T = from_six(values[:, :3], values[:, 3:9])
    return ForeignFile(
        source,
        "DexGraspNet (hand_pose)",
        _squeezed(T, values[:, 9:], None, _scales({"obj_scale": content.get("scale", 1.0)}, len(values), source)),
        _names(content),
        understood=(
            "hand_pose has a position, the first two columns of the rotation, one after the other, and joints.",
        ),
    )


def _pose_and_joints(
    values: NDArray[np.float64], T_world_object: NDArray[np.float64], order: str, source: Path
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Split rows (n, 7 + V) into poses in the object's frame (n, 4, 4) and joints (n, V)."""
    T = from_quaternions(values[:, :3], values[:, 3:7], order, source)
    return inverse_pose(T_world_object) @ T, values[:, 7:]


def _object_poses(content: dict[Any, Any], count: int, order: str, source: Path) -> NDArray[np.float64]:
    if "obj_pose" not in content:
        return np.tile(np.eye(4), (count, 1, 1))
    values = np.atleast_2d(np.asarray(content["obj_pose"], np.float64))
    values = numbers(values, (None, 7), "obj_pose", source)
    T = from_quaternions(values[:, :3], values[:, 3:], order, source)
    return np.broadcast_to(T[0], (count, 4, 4)) if len(T) == 1 else _as_many(T, count, "obj_pose", source)


def _as_many(values: Any, count: int, what: str, source: Path) -> Any:
    if len(values) != count:
        raise UserError(
            f"{source}: {what} has {len(values)} entries for {count} grasps; give one each, or a single one."
        )
    return values


def _scales(content: dict[Any, Any], count: int, source: Path) -> NDArray[np.float64]:
    values = np.asarray(numbers(np.ravel(content.get("obj_scale", 1.0)), (None,), "obj_scale", source))
    return np.full(count, values[0]) if len(values) == 1 else np.asarray(_as_many(values, count, "obj_scale", source))


def _names(content: dict[Any, Any]) -> tuple[str, ...] | None:
    return texts(np.ravel(content["joint_names"]).tolist()) if "joint_names" in content else None


def read_bodex(content: dict[Any, Any], source: Path, order: str) -> ForeignFile:
    """Read what BODex writes: ``robot_pose`` (1, n, 3, 7 + V) of pre-grasp, grasp and squeeze, URDF's root."""
    values = np.asarray(content["robot_pose"])
    values = numbers(values[0] if values.ndim == 4 else values, (None, 3, None), "robot_pose", source)
    count = len(values)
    T, joints = _pose_and_joints(values[:, 1], _object_poses(content, count, order, source), order, source)
    return ForeignFile(
        source,
        "BODex (npy)",
        _squeezed(T, joints, values[:, 2, 7:], _scales(content, count, source)),
        _names(content),
        understood=("robot_pose is of the URDF's root link; its last entry gives the drive targets.",),
    )


def read_bench(content: dict[Any, Any], source: Path, order: str) -> ForeignFile:
    """Read DexGraspBench's form: ``grasp_qpos`` and ``squeeze_qpos`` (7 + V) or (n, 7 + V) in the frame of its MJCF.

    A ``pregrasp_qpos`` is not used: the open hand is chosen here, so that nothing is swept.
    """
    values = np.asarray(content["grasp_qpos"], np.float64)
    values = numbers(np.atleast_2d(values), (None, None), "grasp_qpos", source)
    count = len(values)
    T, joints = _pose_and_joints(values, _object_poses(content, count, order, source), order, source)
    squeeze = None
    if "squeeze_qpos" in content:
        wanted = numbers(np.atleast_2d(np.asarray(content["squeeze_qpos"])), values.shape, "squeeze_qpos", source)
        squeeze = wanted[:, 7:]
    return ForeignFile(
        source,
        "DexGraspBench (npy)",
        _squeezed(T @ BENCH_PALM, joints, squeeze, _scales(content, count, source)),
        _names(content),
        understood=(
            "Poses are of the root of DexGraspBench's MJCF, under which the Allegro's palm is turned by the quaternion "
            "(0, 1, 0, 1).",
        ),
    )


def _squeezed(
    T: NDArray[np.float64],
    joints: NDArray[np.float64],
    squeeze: NDArray[np.float64] | None,
    scales: NDArray[np.float64] | None = None,
) -> tuple[ForeignGrasp, ...]:
    scales = np.ones(len(T)) if scales is None else scales
    return tuple(
        ForeignGrasp((Hold(pose),), q, None if squeeze is None else squeeze[index], float(scales[index]))
        for index, (pose, q) in enumerate(zip(T, joints, strict=True))
    )


def read_frogger(content: dict[Any, Any], source: Path, order: str) -> ForeignFile:
    """Read FRoGGeR's solutions: ``q_star`` (n, 7 + V), quaternion before position, and the object's ``X_WO`` (4, 4)."""
    values = numbers(np.atleast_2d(np.asarray(content["q_star"])), (None, None), "q_star", source)
    if values.shape[1] < 8:
        raise UserError(f"{source}: q_star has {values.shape[1]} values; it needs a pose (7) and joints.")
    T_world_palm = from_quaternions(values[:, 4:7], values[:, :4], order, source)
    T_palm_root = np.eye(4)
    T_palm_root[2, 3] = FROGGER_PALM
    T_world_object = proper_poses(np.asarray(content.get("X_WO", np.eye(4)))[None], "X_WO", source)[0]
    T = inverse_pose(T_world_object) @ T_world_palm @ T_palm_root
    joints = values[:, 7:]
    names = FROGGER_JOINTS if joints.shape[1] == len(FROGGER_JOINTS) else _names(content)
    return ForeignFile(
        source,
        "FRoGGeR (q_star)",
        _squeezed(T, joints, None),
        names,
        understood=("Poses are of algr_rh_palm in the world; the hand's root link is 95 mm along its z.",),
    )


def read_arrays(content: dict[Any, Any], source: Path, order: str) -> ForeignFile:
    """Read ``joints`` (n, V) with ``pose``, or ``position`` (n, 3) and ``quaternion`` (n, 4).

    A ``pose`` is a matrix (n, 4, 4), or position and quaternion (n, 7).
    """
    joints = numbers(np.atleast_2d(np.asarray(content["joints"])), (None, None), "joints", source)
    if "pose" in content:
        pose = np.asarray(content["pose"])
        if pose.ndim < 3 and pose.shape[-1:] == (7,):
            values = numbers(np.atleast_2d(pose), (None, 7), "pose", source)
            T = from_quaternions(values[:, :3], values[:, 3:], order, source)
        else:
            T = proper_poses(pose[None] if pose.ndim == 2 else pose, "pose", source)
    else:
        positions = numbers(np.atleast_2d(entry(content, "position", source)), (None, 3), "position", source)
        rotations = numbers(np.atleast_2d(entry(content, "quaternion", source)), (None, 4), "quaternion", source)
        T = from_quaternions(positions, _as_many(rotations, len(positions), "quaternion", source), order, source)
    _as_many(T, len(joints), "the hand's pose", source)
    squeeze = None
    if "squeeze" in content:
        squeeze = numbers(np.atleast_2d(np.asarray(content["squeeze"])), joints.shape, "squeeze", source)
    understood = ("Poses are of the hand's root link in the frame of the mesh.",)
    return ForeignFile(
        source, "pose and joints (npz)", _squeezed(T, joints, squeeze), _names(content), False, understood
    )


def read_npz(source: Path, order: str) -> ForeignFile:
    """Read named arrays of numbers."""
    try:
        with np.load(source, allow_pickle=False) as file:
            content = {name: np.asarray(file[name]) for name in file.files}
    except Exception as error:  # the readers of zip and npy raise whatever the damage happens to trigger
        raise UserError(
            f"{source} cannot be read as arrays of numbers ({error}); save it again with numpy.savez."
        ) from error
    return read_dictionary(content, source, order)


def read_hdf5(source: Path, order: str) -> ForeignFile:
    """Read SeqMultiGrasp's released schema, of one object or of two; poses are of its y-up meshes."""
    content = _datasets(source)
    qpos = numbers(entry(content, "qpos", source), (None, None), "qpos", source)
    count = len(qpos)
    sets = [("object_0_", True), ("object_1_", True)] if "object_0_pose" in content else [("", False)]
    holds = [_released_holds(content, prefix, inverted, count, source) for prefix, inverted in sets]
    name = f"{sets[0][0]}scale"
    scales = numbers(content.get(name, np.ones(count)), (count,), name, source)
    grasps = tuple(
        ForeignGrasp(tuple(own[index] for own in holds), qpos[index], scale=float(scales[index]))
        for index in range(count)
    )
    understood = ("Poses are of the released y-up meshes: x, y, z there are y, z, x of a mesh with z up.",)
    return ForeignFile(source, "SeqMultiGrasp (HDF5)", grasps, None, True, understood)


def _released_holds(
    content: dict[str, NDArray[Any]], prefix: str, inverted: bool, count: int, source: Path
) -> list[Hold]:
    """Return how one object lies in the hand, by grasp.

    Args:
        inverted: the poses are of the object in the hand's frame.
    """
    six = numbers(entry(content, f"{prefix}pose", source), (count, 6), f"{prefix}pose", source)
    T = from_fixed_angles(six[:, :3], six[:, 3:])
    name = f"{prefix}contact_point_indices"
    contacts = numbers(content.get(name, np.zeros((count, 0))), (count, None), name, source).astype(np.int64)
    T_object_hand = inverse_pose(T) if inverted else T
    return [Hold(pose, contacts=tuple(own.tolist())) for pose, own in zip(T_object_hand, contacts, strict=True)]


def _datasets(source: Path) -> dict[str, NDArray[Any]]:
    """Return the datasets that lie in the file itself: links to other files are not followed."""
    import h5py

    try:
        with h5py.File(source, "r") as file:
            inside = [name for name in file if isinstance(file.get(name, getlink=True), h5py.HardLink)]
            chosen = [name for name in inside if isinstance(file[name], h5py.Dataset)]
            return {name: _values(file[name]) for name in chosen}
    except (OSError, RuntimeError, ValueError, TypeError, KeyError) as error:
        raise UserError(f"{source} cannot be read as HDF5 ({str(error)[:120]}); export it again.") from error


def _values(dataset: Any) -> NDArray[Any]:
    if dataset.dtype.kind not in "fiu" or dataset.is_virtual or dataset.external is not None:
        return np.zeros(0)
    if dataset.size > 1_000_000_000:
        raise ValueError(f"{dataset.name} claims {dataset.size} values")
    return np.asarray(dataset[()])


READERS: dict[str, Callable[[Path, str], ForeignFile]] = {
    ".npy": read_npy_grasps,
    ".npz": read_npz,
    ".h5": read_hdf5,
    ".hdf5": read_hdf5,
    ".json": read_json,
    ".csv": read_csv,
}
