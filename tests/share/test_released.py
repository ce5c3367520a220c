"""Export in the released code's schema: read back with nothing but h5py and the schema's own conventions."""

from __future__ import annotations

import re

import h5py
import numpy as np
import pandas as pd
import pytest
import trimesh
import yaml

from pipeline.hand.model import load_hand
from pipeline.records import paths
from pipeline.records.flat import PAIR_GRASPS, read_flat
from pipeline.records.objects import write_mesh
from pipeline.share import export
from pipeline.share.released import released_contact_indices
from tests.share.made_up import PARAMETERS, STYLES, write_tables


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working folder with two pairs, and the meshes of their objects: boxes of three different sides."""
    write_tables(tmp_path)
    (tmp_path / "params.yaml").write_text(yaml.safe_dump(PARAMETERS))
    for name in (*STYLES["pinch"], *STYLES["side"]):
        box = trimesh.creation.box((0.02, 0.04, 0.06))
        (tmp_path / f"data/prepare/{name}").mkdir(parents=True)
        write_mesh(tmp_path / f"data/prepare/{name}/mesh.ply", box.vertices, box.faces)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def turn(axis: int, angle: float) -> np.ndarray:
    """Rotation about a coordinate axis, written out."""
    c, s = np.cos(angle), np.sin(angle)
    R = np.eye(3)
    one, other = [(1, 2), (2, 0), (0, 1)][axis]
    R[one, one], R[one, other], R[other, one], R[other, other] = c, -s, s, c
    return R


def placed(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points by six numbers: turned about the fixed axes x, then y, then z, and moved."""
    R = turn(2, pose[5]) @ turn(1, pose[4]) @ turn(0, pose[3])
    return points @ R.T + pose[:3]


def rotated(quaternion: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Vectors by a quaternion w, x, y, z, by the formula with cross products."""
    w, u = quaternion[0], np.asarray(quaternion[1:])
    return v + 2 * np.cross(u, np.cross(u, v) + w * v)


def run(*arguments: str) -> None:
    assert export.main([*arguments]) == 0


def test_pairs_have_the_schema_and_are_divided_by_their_contacts(folder, capsys):
    run("pairs.h5")
    assert capsys.readouterr().out.split() == ["pairs-2-2.h5", "pairs-3-2.h5"]
    for contacts in (2, 3):
        with h5py.File(folder / f"pairs-{contacts}-2.h5") as file:
            n = {2: 6, 3: 2}[contacts]  # accepted, of both pairs
            shapes = {name: (data.shape, data.maxshape[0], data.dtype.kind) for name, data in file.items()}
            assert shapes == {
                "object_0_name": ((n,), None, "O"),
                "object_1_name": ((n,), None, "O"),
                "object_0_scale": ((n,), None, "f"),
                "object_1_scale": ((n,), None, "f"),
                "object_0_pose": ((n, 6), None, "f"),
                "object_1_pose": ((n, 6), None, "f"),
                "object_0_qpos": ((n, 16), None, "f"),
                "object_1_qpos": ((n, 16), None, "f"),
                "object_0_contact_point_indices": ((n, contacts), None, "i"),
                "object_1_contact_point_indices": ((n, 2), None, "i"),
                "qpos": ((n, 16), None, "f"),
            }
            assert file["object_0_pose"].dtype == np.float32 and file["object_0_name"][0] == b"cube"
            assert set(file["object_0_scale"][:]) == {1.0}


def test_a_mesh_with_y_up_is_placed_where_the_grasp_has_the_object(folder):
    run("pairs.h5", "--no-contacts", "--meshes", "meshes")
    rows = pd.concat([read_flat(paths.merged_file(name), PAIR_GRASPS, "merge") for name in STYLES["pinch"]])
    rows = rows[rows["rejected_by"] == ""].reset_index()
    upright = trimesh.load_mesh("meshes/plum.stl", process=False).triangles_center
    lying = trimesh.load_mesh("meshes/plum.obj", process=False)
    assert np.allclose(lying.extents, (0.04, 0.06, 0.02))  # x right, y up, z backward, of x, y, z = 2, 4, 6 cm
    with h5py.File("pairs.h5") as file:
        assert "object_0_contact_point_indices" not in file
        assert np.allclose(file["qpos"][:], np.stack(rows["q"]), atol=1e-6)
        assert np.array_equal(file["object_1_qpos"][:], file["qpos"][:])
        for index in (0, 1):
            for number, row in rows.iterrows():
                there = placed(file[f"object_{index}_pose"][number], lying.triangles_center)
                quaternion, position = row[f"quaternion_hand_object{index}"], row[f"position_hand_object{index}"]
                assert np.allclose(there, rotated(quaternion, upright) + position, atol=1e-6)


def test_a_pair_keeps_what_its_single_grasps_were(folder):
    run("pairs.h5", "--first", "plum")
    rows = read_flat(paths.merged_file("plum"), PAIR_GRASPS, "merge")
    rows = rows[rows["rejected_by"] == ""]
    single = pd.read_parquet("data/validate/pinch/plum.parquet").set_index("grasp_id")
    hand = load_hand("allegro")
    of_three = rows[[len(single["contact_candidates"][number]) == 3 for number in rows["grasp0_id"]]]
    with h5py.File("pairs-3-2.h5") as file:
        assert np.allclose(file["object_0_qpos"][:], np.stack(single["q"][of_three["grasp0_id"]]), atol=1e-6)
        # Global indices count through the links as the URDF names them: see how many candidates the links have.
        owner = [link for link in range(len(hand.link_names)) for _ in range(int((hand.contact_link == link).sum()))]
        found = [[owner[i] for i in row] for row in file["object_0_contact_point_indices"][:]]
        expected = [
            hand.contact_link[single["contact_candidates"][number]].tolist() for number in of_three["grasp0_id"]
        ]
        assert found == expected


def test_contact_indices_are_a_permutation_of_the_143_candidates():
    indices = released_contact_indices(load_hand("allegro"))
    assert sorted(indices) == list(range(143))
    assert sorted(indices[:12]) == list(range(12))  # the palm comes first in both


def test_single_grasps_have_the_hand_in_the_object_s_frame(folder):
    run("plum.h5", "--single", "pinch", "--object", "plum")
    single = pd.read_parquet("data/validate/pinch/plum.parquet")
    chosen = single[(single["rejected_by"] == "") & (single["contact_candidates"].map(len) == 2)]
    with h5py.File("plum-2.h5") as file:
        assert set(file) == {"object_name", "scale", "pose", "qpos", "contact_point_indices"}
        for pose, (_, row) in zip(file["pose"][:], chosen.iterrows(), strict=True):
            points = np.random.default_rng(0).normal(size=(4, 3))  # in the hand's frame
            ours = rotated(row["quaternion_object_hand"], points) + row["position_object_hand"]
            assert np.allclose(placed(pose, points), ours[:, [1, 2, 0]], atol=1e-6)  # y-up x, y, z are our y, z, x


def test_the_same_grasps_give_the_same_bytes_and_a_file_is_never_replaced(folder, capsys):
    run("one.h5", "--no-contacts")
    run("two.h5", "--no-contacts")
    assert (folder / "one.h5").read_bytes() == (folder / "two.h5").read_bytes()
    assert export.main(["one.h5", "--no-contacts"]) == 2
    assert capsys.readouterr().err == "export: one.h5 is there already; remove it or name another file.\n"


def test_a_table_says_what_its_columns_mean(folder):
    import pyarrow.parquet as pq

    run("all.parquet", "--all", "--source", "synthesized", "learned")
    schema = pq.read_schema("all.parquet")
    assert pd.read_parquet("all.parquet")["source"].value_counts().to_dict() == {"synthesized": 10, "learned": 10}
    assert all(schema.field(name).metadata[b"description"] for name in schema.names)


def test_the_commands_and_the_snippet_of_the_page_do_what_it_says(folder, repository, capsys):
    page = (repository / "docs/sharing.md").read_text()
    commands = re.findall(r"^python -m pipeline\.share\.export (.+)$", page, flags=re.MULTILINE)
    assert len(commands) == 3
    for command in commands:
        run(*command.split())
    assert capsys.readouterr().out.split() == [
        "grasps.parquet",
        *("grasps-2-2.h5", "grasps-3-2.h5"),
        *(f"meshes/{name}{suffix}" for name in ("can", "cube", "plum") for suffix in (".obj", ".stl")),
        *("cube-2.h5", "cube-3.h5"),
    ]
    (snippet,) = re.findall(r"^```python\n(.*?)^```$", page, flags=re.MULTILINE | re.DOTALL)
    exec(snippet, {})
    assert re.search(r"^cube +can +4$", capsys.readouterr().out, re.MULTILINE)
    with h5py.File("grasps-2-2.h5") as file:
        named = set(re.findall(r"`((?:object_i_)?\w+)`", page))
        assert {name.replace("_0_", "_i_").replace("_1_", "_i_") for name in file} <= named


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["x.npy"], "neither the ending .parquet nor .h5"),
        (["x.h5", "--all"], "cannot say what was rejected"),
        (["x.h5", "--source", "learned"], "give --no-contacts"),
        (["x.h5", "--single", "pinch"], "are written as"),
        (["x.h5", "--single", "side", "--object", "cube"], "choose among can"),
        (["x.h5", "--first", "mug"], "has no first 'mug'"),
        (["x.h5", "--no-contacts", "--repository", "nowhere"], "no git repository at nowhere"),
    ],
)
def test_what_cannot_be_done_is_one_sentence(folder, arguments, said, capsys):
    assert export.main(arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line and not list(folder.glob("x*"))
