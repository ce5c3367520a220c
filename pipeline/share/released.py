"""Grasps in the HDF5 schema of the paper's released code (SeqMultiGrasp), and meshes that fit them.

What is known of that schema, and followed here: the datasets' names, their axis 0 (one entry per grasp, resizable),
6-number poses (translation in metres, then extrinsic xyz angles: R = Rz Ry Rx), 16 joints in the order joint_0.0 ...
joint_15.0, float32 and int32 in files of single grasps, scale 1.0, a fixed number of contact indices per file, objects
with y up, and global contact indices that count through the links in the order of the URDF.

What could not be known, and what is done about it:

- whether names are variable or fixed strings: they are variable UTF-8;
- number types in files of pairs: as in files of single grasps;
- the order of contact candidates within a link: ours; so an index leads to the right link, perhaps not to the point;
- ``object_i_qpos`` of sampled grasps, which are not made of two single ones: the grasp's own joints.

Objects have the names of this project, as the released meshes lie in other frames: use :func:`write_meshes`.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import ArrayLike, NDArray

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.geometry import read_geometry
from pipeline.records.poses import inverse_pose, pose_matrix
from pipeline.records.tables import VALIDATED
from pipeline.records.writing import whole_file
from pipeline.share.project import Project, read_columns

if TYPE_CHECKING:
    from pipeline.hand.model import Hand

# Released z-up coordinates (x, y, z) are its y-up ones (z, x, y): T_ours_released of an object.
Z_UP_FROM_Y_UP = np.array([[0.0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
RELEASED_JOINTS = 16  # joint_0.0 ... joint_15.0 of the Allegro hand
NOTES = {
    "schema": "SeqMultiGrasp, released code",
    "joints": "rad, joint_0.0 ... joint_15.0",
    "poses": "translation (m), then angles (rad) about the fixed axes x, y, z",
    "object_frame": "origin at the centre of mass, y up; the hand's frame is its base_link",
}
_SINGLE = pa.schema(
    [
        VALIDATED.field(name)
        for name in (
            "grasp_id",
            "position_object_hand",
            "quaternion_object_hand",
            "q",
            "contact_candidates",
            "rejected_by",
        )
    ]
)


def six_numbers(T: ArrayLike) -> NDArray[np.float32]:
    """Return translation and extrinsic xyz angles (n, 6) of poses (n, 4, 4)."""
    from scipy.spatial.transform import Rotation

    T = np.asarray(T, np.float64)
    with warnings.catch_warnings():
        # Where the second angle is 90 degrees, one of the others is free: the pose is right all the same.
        warnings.simplefilter("ignore", UserWarning)
        angles = Rotation.from_matrix(T[:, :3, :3]).as_euler("xyz")
    return np.concatenate([T[:, :3, 3], angles], axis=1).astype(np.float32)


def released_contact_indices(hand: Hand) -> NDArray[np.int64]:
    """Return for each of our contact candidates (C,) the index in an order that goes by links as in the URDF."""
    order = np.argsort(hand.contact_link, kind="stable")
    indices = np.empty(len(order), np.int64)
    indices[order] = np.arange(len(order))
    return indices


def read_single_grasps(project: Project, style: str, object_name: str) -> pd.DataFrame:
    """Return what is exported of the single grasps of an object, by ``grasp_id``; rejected ones too.

    Raises:
        UserError: the table is missing or damaged.
    """
    stage = f"validate@{style}"
    rows = read_columns(project, paths.validated_file(style, object_name), _SINGLE, stage)
    return rows.set_index("grasp_id")


def single_arrays(object_name: str, grasps: pd.DataFrame, hand: Hand) -> list[dict[str, NDArray]]:
    """Return the datasets of the validated grasps of one object, one dictionary per number of contacts."""
    rows = grasps[grasps["rejected_by"] == ""]
    poses = pose_matrix(_stacked(rows["position_object_hand"], 3), _stacked(rows["quaternion_object_hand"], 4))
    content = {
        "object_name": np.full(len(rows), object_name, dtype=object),
        "scale": np.ones(len(rows), np.float32),
        "pose": six_numbers(inverse_pose(Z_UP_FROM_Y_UP) @ poses),
        "qpos": _stacked(rows["q"], RELEASED_JOINTS).astype(np.float32),
    }
    contacts = {"contact_point_indices": _contacts(rows["contact_candidates"], hand)}
    return _by_number_of_contacts(content, contacts)


def pair_arrays(
    grasps: pd.DataFrame, singles: Mapping[tuple[str, str], pd.DataFrame] | None, hand: Hand
) -> list[dict[str, NDArray]]:
    """Return the datasets of two-object grasps, one dictionary per number of contacts.

    Args:
        grasps: rows of :func:`pipeline.share.load_grasps`.
        singles: by style and object, what the grasps were merged from; None for learned grasps, and to leave the
            contacts out: ``object_i_qpos`` is then the grasp's own.

    Raises:
        UserError: a single grasp that a grasp is made of is not in its table.
    """
    qpos = _stacked(grasps["q"], RELEASED_JOINTS).astype(np.float32)
    content: dict[str, NDArray] = {"qpos": qpos}
    contacts: dict[str, list[NDArray[np.int32]]] = {}
    for index, style in enumerate(("pinch", "side")):
        T = pose_matrix(
            _stacked(grasps[f"position_hand_object{index}"], 3), _stacked(grasps[f"quaternion_hand_object{index}"], 4)
        )
        content[f"object_{index}_name"] = grasps[f"object{index}"].to_numpy(object)
        content[f"object_{index}_scale"] = np.ones(len(grasps), np.float32)
        content[f"object_{index}_pose"] = six_numbers(T @ Z_UP_FROM_Y_UP)
        content[f"object_{index}_qpos"] = qpos
        if singles is not None:
            parts = _parts(grasps, index, style, singles)
            content[f"object_{index}_qpos"] = _stacked(parts["q"], RELEASED_JOINTS).astype(np.float32)
            contacts[f"object_{index}_contact_point_indices"] = _contacts(parts["contact_candidates"], hand)
    return _by_number_of_contacts(content, contacts)


def _parts(
    grasps: pd.DataFrame, index: int, style: str, singles: Mapping[tuple[str, str], pd.DataFrame]
) -> pd.DataFrame:
    """The rows of the single grasps that merged grasps are made of, in their order."""
    found = []
    for name, number in zip(grasps[f"object{index}"], grasps[f"grasp{index}_id"], strict=True):
        rows = singles[style, name]
        if number not in rows.index:
            file = paths.validated_file(style, name)
            raise UserError(f"{file} has no grasp {number}, of which a merged grasp is made; run `dvc repro merge`.")
        found.append(rows.loc[number])
    return pd.DataFrame(found, columns=_SINGLE.names[1:])


def _stacked(column: Iterable[ArrayLike], width: int) -> NDArray[np.float64]:
    return np.array(list(column), np.float64).reshape(-1, width)


def _contacts(column: Iterable[ArrayLike], hand: Hand) -> list[NDArray[np.int32]]:
    indices = released_contact_indices(hand)
    return [indices[np.asarray(own, np.int64)].astype(np.int32) for own in column]


def _by_number_of_contacts(
    content: Mapping[str, NDArray], contacts: Mapping[str, list[NDArray[np.int32]]]
) -> list[dict[str, NDArray]]:
    """Divide grasps, as a dataset has one width."""
    if not contacts:
        return [dict(content)]
    counts = np.array([[len(own) for own in column] for column in contacts.values()]).T
    parts = []
    for wanted in np.unique(counts, axis=0):
        chosen = np.flatnonzero((counts == wanted).all(axis=1))
        part = {name: values[chosen] for name, values in content.items()}
        parts.append(part | {name: np.stack([column[i] for i in chosen]) for name, column in contacts.items()})
    return parts


def write_hdf5(target: Path, parts: list[dict[str, NDArray]]) -> list[Path]:
    """Write one file per part and return their paths: ``target``, or with the numbers of contacts added to its name.

    The same grasps give the same bytes.

    Raises:
        UserError: there are no grasps, or a file is there already.
    """
    import h5py

    if not any(len(values) for part in parts for values in part.values()):
        raise UserError(f"there is no grasp to write to {target}; choose others.")
    targets = [target]
    if len(parts) > 1:
        targets = [target.with_name(f"{target.stem}-{_widths(part)}{target.suffix}") for part in parts]
    for path in targets:
        if path.exists():
            raise UserError(f"{path} is there already; remove it or name another file.")
    for path, part in zip(targets, parts, strict=True):
        with whole_file(path) as temporary, h5py.File(temporary, "w") as file:
            file.attrs.update(NOTES)
            for name in sorted(part):
                values = part[name]
                kind = h5py.string_dtype() if values.dtype == object else values.dtype
                file.create_dataset(name, data=values, dtype=kind, maxshape=(None, *values.shape[1:]))
    return targets


def _widths(part: Mapping[str, NDArray]) -> str:
    return "-".join(str(values.shape[1]) for name, values in sorted(part.items()) if name.endswith("indices"))


def write_meshes(project: Project, names: Iterable[str], folder: Path) -> list[Path]:
    """Write, for every object, ``NAME.obj`` (y up, the frame of the exported poses) and ``NAME.stl`` (z up).

    The released code optimises grasps on the first and simulates with the second, and takes poses from one to the other
    by exchanging axes, as between these two.

    Raises:
        UserError: a mesh is missing or damaged.
    """
    import trimesh

    written = []
    for name in names:
        path = paths.prepared_folder(name) / "mesh.ply"
        content = project.read(path, "prepare")
        try:
            mesh = read_geometry(content, "ply")
            upright = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        except (ValueError, AttributeError) as error:
            raise UserError(f"{project.where(path)} is damaged; fetch or make it again.") from error
        lying = upright.copy()
        lying.apply_transform(inverse_pose(Z_UP_FROM_Y_UP))
        for suffix, one in ((".obj", lying), (".stl", upright)):
            with whole_file(folder / f"{name}{suffix}") as temporary:
                one.export(str(temporary), file_type=suffix[1:])
            written.append(folder / f"{name}{suffix}")
    return written
