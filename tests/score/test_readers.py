"""Every format gives back the grasps that were written in it, whatever its frames and orders."""

from __future__ import annotations

import json
import pickle

import h5py
import numpy as np
import pytest

from pipeline.records.errors import UserError
from pipeline.records.poses import inverse_pose
from pipeline.score.joints import joint_of, map_joints
from pipeline.score.readers import FROGGER_JOINTS, read_grasps
from pipeline.score.unpickled import read_npy
from pipeline.share.released import Z_UP_FROM_Y_UP
from tests.score import foreign_files

SINGLE = 2e-6  # files in 32 bits


SAME = np.eye(4)


def check(file, grasps, hand, squeezed, T=SAME):
    joints = map_joints(file.joint_names, len(file.grasps[0].joints), hand)
    assert [name for _, name in joints.pairs] == list(hand.joint_names)
    for found, own in zip(file.grasps, grasps, strict=True):
        np.testing.assert_allclose(T @ found.holds[0].T_object_hand, own.T_object_hand[0], atol=SINGLE)
        np.testing.assert_allclose(found.joints[joints.columns], own.q, atol=SINGLE)
        assert (found.squeeze is not None) == squeezed
        if squeezed:
            np.testing.assert_allclose(found.squeeze[joints.columns], own.squeeze_q, atol=SINGLE)
    return file


def test_dexgraspnet(tmp_path, grasps, hand):
    foreign_files.dexgraspnet(tmp_path / "g.npy", grasps, hand, scale=0.5)
    file = check(read_grasps(tmp_path / "g.npy", "wxyz"), grasps, hand, squeezed=False)
    assert file.grasps[0].scale == 0.5 and file.joint_names[0] == "joint_15.0"


@pytest.mark.parametrize("interleaved", [False, True])
def test_hand_pose_of_dexgraspnet(tmp_path, grasps, hand, interleaved):
    """Two columns of the rotation; not yet at right angles, they are moved by as much each."""
    rows = []
    for own in grasps:
        (T,) = own.T_object_hand
        six = T[:3, :2].ravel() if interleaved else np.concatenate([T[:3, 0], T[:3, 1]])
        rows.append(np.concatenate([T[:3, 3], six, own.q]))
    np.savez(tmp_path / "g.npz", hand_pose=np.array(rows))
    check(read_grasps(tmp_path / "g.npz", "wxyz"), grasps, hand, squeezed=False)
    if not interleaved:
        leaning = np.array(rows)
        angle = 0.1  # rad, of both towards each other in their plane
        x, y = leaning[:, 3:6].copy(), leaning[:, 6:9].copy()
        leaning[:, 3:6] = 1.7 * (np.cos(angle) * x + np.sin(angle) * y)
        leaning[:, 6:9] = 0.4 * (np.sin(angle) * x + np.cos(angle) * y)
        np.save(tmp_path / "g.npy", {"hand_pose": leaning}, allow_pickle=True)
        check(read_grasps(tmp_path / "g.npy", "wxyz"), grasps, hand, squeezed=False)


@pytest.mark.parametrize("name", ["joints", "q", "qpos"])
def test_pose_and_joints(tmp_path, grasps, hand, name):
    T = np.array([own.T_object_hand[0] for own in grasps])
    q = np.array([own.q for own in grasps])
    np.savez(tmp_path / "g.npz", pose=T, **{name: q})
    check(read_grasps(tmp_path / "g.npz", "wxyz"), grasps, hand, squeezed=False)
    seven = [np.concatenate([pose[:3, 3], np.roll(foreign_files.wxyz(pose[:3, :3]), -1)]) for pose in T]
    np.savez(tmp_path / "g.npz", pose=np.array(seven), **{name: q})
    check(read_grasps(tmp_path / "g.npz", "xyzw"), grasps, hand, squeezed=False)
    np.savez(tmp_path / "g.npz", pose=T.swapaxes(1, 2), **{name: q})
    with pytest.raises(UserError, match="last row of pose is not 0, 0, 0, 1; transpose it"):
        read_grasps(tmp_path / "g.npz", "wxyz")


def test_bodex(tmp_path, grasps, hand):
    foreign_files.bodex(tmp_path / "g.npy", grasps, hand)
    check(read_grasps(tmp_path / "g.npy", "wxyz"), grasps, hand, squeezed=True)


def test_folder_of_dexgraspbench(tmp_path, grasps, hand):
    foreign_files.bench(tmp_path / "grasps", grasps)
    check(read_grasps(tmp_path / "grasps", "wxyz"), grasps, hand, squeezed=True)


def test_frogger(tmp_path, grasps, hand):
    foreign_files.frogger(tmp_path / "g.npz", grasps)
    check(read_grasps(tmp_path / "g.npz", "wxyz"), grasps, hand, squeezed=False)


@pytest.mark.parametrize("order", ["wxyz", "xyzw"])
def test_own_json(tmp_path, grasps, hand, order):
    foreign_files.own_json(tmp_path / "g.json", grasps, hand, order)
    file = check(read_grasps(tmp_path / "g.json", order), grasps, hand, squeezed=True)
    assert file.grasps[0].holds[0].fingers == ("thumb", "middle")


@pytest.mark.parametrize("order", ["wxyz", "xyzw"])
def test_own_csv_has_names_for_its_quaternions(tmp_path, grasps, hand, order):
    foreign_files.own_csv(tmp_path / "g.csv", grasps, hand)
    check(read_grasps(tmp_path / "g.csv", order), grasps, hand, squeezed=True)


def test_released_single_grasps_have_y_up(tmp_path, grasps, hand):
    foreign_files.released_single(tmp_path / "g.h5", grasps, hand)
    file = check(read_grasps(tmp_path / "g.h5", "wxyz"), grasps, hand, squeezed=False, T=Z_UP_FROM_Y_UP)
    assert file.y_up and len(file.grasps[0].holds[0].contacts) == 2


def test_pairs_that_this_project_exports_come_back(tmp_path, hand):
    import pandas as pd

    from pipeline.records.poses import pose_matrix
    from pipeline.share.released import pair_arrays, write_hdf5
    from tests.share.made_up import merged

    rows = pd.DataFrame(merged("cube", "can", np.random.default_rng(3)))
    write_hdf5(tmp_path / "pairs.h5", pair_arrays(rows, None, hand))
    file = read_grasps(tmp_path / "pairs.h5", "wxyz")
    for grasp, row in zip(file.grasps, rows.itertuples(), strict=True):
        for index, hold in enumerate(grasp.holds):
            T = pose_matrix(
                getattr(row, f"position_hand_object{index}"), getattr(row, f"quaternion_hand_object{index}")
            )
            np.testing.assert_allclose(Z_UP_FROM_Y_UP @ hold.T_object_hand, inverse_pose(T), atol=1e-5)


# --- joint names


@pytest.mark.parametrize(
    ("name", "joint"),
    [
        ("joint_10", "joint_10.0"),
        ("joint_1.0", "joint_1.0"),
        ("ffj0", "joint_0.0"),
        ("rfj3", "joint_11.0"),
        ("allegro/thj1", "joint_13.0"),
        (FROGGER_JOINTS[5], "joint_5.0"),
        ("robot0:FFJ9", None),
        ("knee", None),
    ],
)
def test_names_of_joints(hand, name, joint):
    assert joint_of(name, hand) == joint


def test_a_joint_of_another_hand_is_named(hand):
    names = ["robot0:LFJ4", *hand.joint_names[1:]]
    with pytest.raises(UserError, match="'robot0:LFJ4' is no joint.*--hand"):
        map_joints(names, 16, hand)
    chosen = map_joints(names, 16, hand, hand.joint_names)
    assert chosen.pairs[0] == ("robot0:LFJ4", "joint_0.0")


# --- nothing is executed


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_plain_data_of_every_protocol(tmp_path, protocol):
    content = {
        "numbers": np.arange(6.0).reshape(2, 3),
        "columns": np.asfortranarray(np.arange(6, dtype=">i4").reshape(2, 3)),
        "scalar": np.float32(0.5),
        "list": [1, -2, 3.5, None, True, b"bytes", "text", (1, 2)],
    }
    write_objects(tmp_path / "x.npy", np.array(content, dtype=object), protocol)
    found = read_npy(tmp_path / "x.npy")
    np.testing.assert_array_equal(found["numbers"], content["numbers"])
    np.testing.assert_array_equal(found["columns"], content["columns"])
    assert found["scalar"] == 0.5 and found["list"] == [1, -2, 3.5, None, True, b"bytes", "text", [1, 2]]


def write_objects(target, array, protocol):
    with target.open("wb") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "|O", "fortran_order": False, "shape": array.shape})
        pickle.dump(array, file, protocol=protocol)


class Bomb:
    def __init__(self, canary):
        self.canary = canary

    def __reduce__(self):
        import os

        return os.mknod, (str(self.canary),)


@pytest.mark.parametrize("protocol", [0, 2, 4])
def test_a_call_is_refused_by_name(tmp_path, protocol):
    canary = tmp_path / "executed"
    write_objects(tmp_path / "x.npy", np.array([{"qpos": Bomb(canary)}], dtype=object), protocol)
    with pytest.raises(UserError, match=r"holds posix\.mknod, which is no plain data"):
        read_npy(tmp_path / "x.npy")
    assert not canary.exists()
    np.load(tmp_path / "x.npy", allow_pickle=True)  # the file is what it seems
    assert canary.exists()


@pytest.mark.parametrize(
    "program",
    [
        b"cbuiltins\neval\n(V1\ntR.",
        b"cnumpy.core.multiarray\n_reconstruct\n(cos\nsystem\ntR.",
        b"]q\x00h\x00a.",  # a list in itself
        b"]q\x00"
        + b"".join(b"]q%c(" % (i + 1) + b"h%c" % i * 10 + b"e" for i in range(12))
        + b".",  # ten times ten times
        b"(lp0\nI1\n",  # no end
        b"cnumpy\ndtype\n(VO8\ntR.",
        b"\x80\x04\x8c\x02os\x8c\x06system\x93\x8c\x02ls\x85R.",
    ],
)
def test_other_programs_are_refused_in_a_sentence(tmp_path, program):
    with (tmp_path / "x.npy").open("wb") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "|O", "fortran_order": False, "shape": ()})
        file.write(program)
    with pytest.raises(UserError, match=r"x\.npy (holds|is damaged)"):
        read_npy(tmp_path / "x.npy")


def test_a_damaged_file_is_refused_in_a_sentence(tmp_path, grasps, hand):
    foreign_files.bodex(tmp_path / "g.npy", grasps, hand)
    whole = (tmp_path / "g.npy").read_bytes()
    rng = np.random.default_rng(0)
    for _ in range(150):
        damaged = bytearray(whole[: rng.integers(20, len(whole) + 1)])
        for place in rng.integers(0, len(damaged), 3):
            damaged[place] = rng.integers(256)
        (tmp_path / "d.npy").write_bytes(damaged)
        try:
            read_grasps(tmp_path / "d.npy", "wxyz")
        except UserError as error:
            assert str(error).endswith((".", "\n")) or "d.npy" in str(error)


def test_hdf5_leads_to_no_other_file(tmp_path):
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["qpos"] = np.zeros((1, 16))
    with h5py.File(tmp_path / "g.h5", "w") as file:
        file["qpos"] = h5py.ExternalLink("secret.h5", "/qpos")
        file["pose"] = np.zeros((1, 6))
    with pytest.raises(UserError, match="has no 'qpos'"):
        read_grasps(tmp_path / "g.h5", "wxyz")


# --- bad input


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c: c["grasps"][1].update(joints=[0.0] * 15), r"joints of grasp 1 has the shape \(15,\), not 16"),
        (
            lambda c: c["grasps"][0]["holds"][0].update(quaternion=[2, 0, 0, 0]),
            "quaternion of grasp 0 has the length 2",
        ),
        (lambda c: c["grasps"][0]["holds"][0].update(position=[0, 0, float("nan")]), "not a number"),
        (lambda c: c.pop("joint_names"), "has no 'joint_names'"),
        (lambda c: c.update(grasps=[]), "holds 0 grasps"),
        (lambda c: c["grasps"][0].pop("joints"), "has no 'joints'"),
    ],
)
def test_bad_json_is_refused_in_a_sentence(tmp_path, grasps, hand, change, words):
    foreign_files.own_json(tmp_path / "g.json", grasps, hand)
    content = json.loads((tmp_path / "g.json").read_text())
    change(content)
    (tmp_path / "g.json").write_text(json.dumps(content))
    with pytest.raises(UserError, match=words):
        read_grasps(tmp_path / "g.json", "wxyz")


@pytest.mark.parametrize("name", ["missing.npy", "g.txt"])
def test_no_such_file_or_format(tmp_path, name):
    (tmp_path / "g.txt").write_text("1 2 3")
    with pytest.raises(UserError, match="missing|endings"):
        read_grasps(tmp_path / name, "wxyz")
