"""Our grasps written as other projects write theirs, by formulas of their own code, not by our readers turned round."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.hand.model import Hand
from pipeline.share.released import released_contact_indices

FROGGER = [f"algr_rh_{finger}" for finger in ("if", "mf", "rf", "th")]


@dataclass(frozen=True)
class Own:
    """A grasp of this project, of one object or two."""

    T_object_hand: Sequence[NDArray[np.float64]]  # (4, 4) each
    q: NDArray[np.float64]
    squeeze_q: NDArray[np.float64]
    fingers: Sequence[str]
    contacts: Sequence[Sequence[int]]  # our candidates


def wxyz(R: NDArray[np.float64]) -> NDArray[np.float64]:
    return Rotation.from_matrix(R).as_quat(scalar_first=True)


def dexgraspnet(target: Path, grasps: Sequence[Own], hand: Hand, scale: float = 1.0, contacts: bool = False) -> None:
    """As `generate_grasps.py` of DexGraspNet saves a list of dictionaries: transforms3d's `sxyz` angles."""
    records = []
    for own in grasps:
        (T,) = own.T_object_hand
        angles = Rotation.from_matrix(T[:3, :3]).as_euler("xyz").tolist()
        qpos = dict(zip(reversed(hand.joint_names), reversed(own.q.tolist()), strict=True))  # in another order
        qpos |= dict(zip(("WRJRx", "WRJRy", "WRJRz"), angles, strict=True))
        qpos |= dict(zip(("WRJTx", "WRJTy", "WRJTz"), T[:3, 3].tolist(), strict=True))
        record = {"scale": scale, "qpos": qpos, "energy": 1.5, "E_fc": 0.1}
        if contacts:
            record["contact_point_indices"] = released_contact_indices(hand)[list(own.contacts[0])].tolist()
        records.append(record)
    np.save(target, records, allow_pickle=True)


def bodex(target: Path, grasps: Sequence[Own], hand: Hand) -> None:
    """As BODex saves a batch: (1, n, 3, 7 + J), the object away from the origin."""
    T_world_object = np.eye(4)
    T_world_object[:3, :3] = Rotation.from_euler("z", 0.7).as_matrix()
    T_world_object[:3, 3] = [0.3, -0.1, 0.2]
    rows = []
    for own in grasps:
        T = T_world_object @ own.T_object_hand[0]
        pose = np.concatenate([T[:3, 3], wxyz(T[:3, :3])])
        rows.append([np.concatenate([pose, q]) for q in (own.q - 0.1, own.q, own.squeeze_q)])
    content = {
        "robot_pose": np.array(rows, np.float32)[None],
        "joint_names": list(hand.joint_names),
        "obj_pose": np.concatenate([T_world_object[:3, 3], wxyz(T_world_object[:3, :3])])[None],
        "obj_scale": np.ones(1),
    }
    np.save(target, content, allow_pickle=True)


def bench(folder: Path, grasps: Sequence[Own]) -> None:
    """As DexGraspBench's `convert_format.py` saves a file each: the rotation times that of (0, 1, 0, 1) inverted."""
    folder.mkdir()
    palm = Rotation.from_quat(np.array([0.0, 1.0, 0.0, 1.0]) / np.sqrt(2), scalar_first=True)
    for index, own in enumerate(grasps):
        (T,) = own.T_object_hand
        turned = (Rotation.from_matrix(T[:3, :3]) * palm.inv()).as_quat(scalar_first=True)
        pose = np.concatenate([T[:3, 3], turned])
        content = {
            "obj_pose": np.array([0, 0, 0, 1.0, 0, 0, 0]),
            "obj_scale": 1.0,
            "obj_path": "assets/object",
            "pregrasp_qpos": np.concatenate([pose, own.q - 0.1]),
            "grasp_qpos": np.concatenate([pose, own.q]),
            "squeeze_qpos": np.concatenate([pose, own.squeeze_q]),
        }
        np.save(folder / f"{index}.npy", content, allow_pickle=True)


def frogger(target: Path, grasps: Sequence[Own]) -> None:
    """As FRoGGeR's `q_star`: quaternion, position of algr_rh_palm, joints, with the object lifted."""
    X_WO = np.eye(4)
    X_WO[:3, 3] = [0.7, 0.0, 0.05]
    rows = []
    for own in grasps:
        T = X_WO @ own.T_object_hand[0]
        position = T[:3, 3] - 0.095 * T[:3, 2]
        rows.append(np.concatenate([wxyz(T[:3, :3]), position, own.q]))
    np.savez(target, q_star=np.array(rows), X_WO=X_WO)


def own_json(target: Path, grasps: Sequence[Own], hand: Hand, order: str = "wxyz", squeeze: bool = True) -> None:
    records = []
    for own in grasps:
        holds = []
        for T, fingers in zip(own.T_object_hand, own.fingers, strict=True):
            quaternion = wxyz(T[:3, :3])
            told = quaternion if order == "wxyz" else np.roll(quaternion, -1)
            holds.append({"position": T[:3, 3].tolist(), "quaternion": told.tolist(), "fingers": fingers})
        record = {"holds": holds, "joints": own.q.tolist()}
        records.append(record | ({"squeeze": own.squeeze_q.tolist()} if squeeze else {}))
    target.write_text(json.dumps({"joint_names": list(hand.joint_names), "grasps": records}))


def own_csv(target: Path, grasps: Sequence[Own], hand: Hand) -> None:
    with target.open("w", newline="") as file:
        writer = csv.writer(file)
        names = [f"joint_{index}" for index in range(len(hand.joint_names))]
        writer.writerow(
            ["x", "y", "z", "qw", "qx", "qy", "qz", "fingers", *names, *(f"squeeze:{name}" for name in names)]
        )
        for own in grasps:
            (T,) = own.T_object_hand
            writer.writerow([*T[:3, 3], *wxyz(T[:3, :3]), own.fingers[0], *own.q, *own.squeeze_q])


def released_single(target: Path, grasps: Sequence[Own], hand: Hand) -> None:
    """As SeqMultiGrasp's HDF5 of one object: y up, so that x, y, z there are our y, z, x."""
    poses = []
    for own in grasps:
        (T,) = own.T_object_hand
        R = T[[1, 2, 0], :3]
        poses.append(np.concatenate([T[[1, 2, 0], 3], Rotation.from_matrix(R).as_euler("xyz")]))
    indices = released_contact_indices(hand)
    with h5py.File(target, "w") as file:
        file["object_name"] = np.array(["cube"] * len(grasps), dtype="S")
        file["scale"] = np.ones(len(grasps), np.float32)
        file["pose"] = np.array(poses, np.float32)
        file["qpos"] = np.array([own.q for own in grasps], np.float32)
        file["contact_point_indices"] = np.array([indices[list(own.contacts[0])] for own in grasps], np.int32)
