"""`./dev score`: verdicts, hints, the page, and one sentence for what cannot be scored."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from pipeline.hand.kinematics import link_poses
from pipeline.records.parameters import read_parameters
from pipeline.records.poses import inverse_pose
from pipeline.score.__main__ import main
from pipeline.score.assignment import assign
from pipeline.score.foreign import Hold
from pipeline.score.frames import Placed, check_frames
from tests.objects import box_distance, exact_grid, prepared
from tests.score import foreign_files
from tests.score.conftest import in_mesh_frame
from tests.score.foreign_files import Own


def scored(*arguments: str) -> pd.DataFrame:
    assert main([*arguments]) == 0
    return pd.read_csv("scores/scores.csv", keep_default_na=False)


def refused(capsys, *arguments: str) -> str:
    assert main([*arguments]) == 2
    words = capsys.readouterr().err
    assert words.count("\n") == 1
    return words


def test_a_grasp_holds_in_both_engines_and_beside_the_object_it_does_not(clone, grasps, hand):
    foreign_files.own_json(clone / "g.json", [in_mesh_frame(own) for own in grasps], hand, squeeze=False)
    table = scored("g.json", "--object", "block.stl", "--unit", "m")
    assert table["verdict"].tolist()[:2] == ["holds", "holds"]  # a block looks the same after a quarter turn
    assert table["sapien_failed"][2].startswith("gravity") and table["mujoco_failed"][2].startswith("gravity")
    assert "; " in table["sapien_failed"][2]  # every check was made, also after the first that failed
    assert 0 <= float(table["sapien_robustness"][0]) <= 1 and table["sapien_robustness"][2] == ""
    assert table["contact_distance_mm"][0] < 5 < table["contact_distance_mm"][2]
    page = (clone / "scores/scores.html").read_text()
    assert page.count("data:image/webp;base64,") == 3 and "http" not in page.replace("http://www.w3.org", "")
    assert "joint_15.0" in page and "holds its object" not in page


def test_the_frame_of_a_scaled_mesh_is_that_of_the_file(clone, grasps, hand):
    """A block of 84 mm, and grasps of one half as large, as DexGraspNet has them."""
    big = trimesh.creation.box([0.084] * 3)
    big.apply_translation([0.2, 0.0, 0.04])
    big.export("big.stl")
    foreign_files.dexgraspnet(clone / "g.npy", [in_mesh_frame(grasps[0])], hand, scale=0.5)
    table = scored("g.npy", "--object", "big.stl", "--unit", "m", "--engine", "sapien")
    assert table["verdict"].tolist() == ["holds"] and table["contact_distance_mm"][0] < 5


def wrongly(change, grasps):
    found = []
    for own in grasps:
        T, q = change(in_mesh_frame(own).T_object_hand[0], own.q)
        found.append(Own([T], q, own.squeeze_q, own.fingers, own.contacts))
    return found


def in_millimetres(T, q):
    T = T.copy()
    T[:3, 3] *= 1000
    return T, q


@pytest.mark.parametrize(
    ("change", "hint"),
    [
        (lambda T, q: (inverse_pose(T), q), "--inverse"),
        (in_millimetres, "divide them by 1000"),
        (lambda T, q: (T, np.degrees(q)), "degrees"),
    ],
)
def test_wrong_frames_are_recognised(clone, capsys, grasps, hand, change, hint):
    foreign_files.own_json(clone / "g.json", wrongly(change, grasps[:2]), hand)
    assert hint in refused(capsys, "g.json", "--object", "block.stl", "--unit", "m")
    assert not (clone / "scores").exists()


@pytest.mark.parametrize("spread", [1, -1])
def test_a_left_hand_is_recognised(grasps, hand, spread):
    """A rod between the tips of index finger and thumb, seen in a mirror: a left hand's, however its joints are signed.

    A right hand with the left one's joints has its index finger at the other end.
    """
    q = grasps[0].q.copy()
    q[[0, 4, 8]] = 0.3
    tips = [link_poses(hand, q[None])[0][hand.link(name)][:3, 3] for name in ("link_3.0_tip", "link_15.0_tip")]
    along = (tips[1] - tips[0]) / np.linalg.norm(tips[1] - tips[0])
    half = np.array([0.004, 0.004, np.linalg.norm(tips[1] - tips[0]) / 2 - 0.012])
    T_hand_rod = np.eye(4)
    T_hand_rod[:3, :3] = Rotation.align_vectors([along], [[0, 0, 1]])[0].as_matrix()
    T_hand_rod[:3, 3] = (tips[0] + tips[1]) / 2
    mesh = trimesh.creation.box(2 * half)
    rod = prepared("rod", mesh, **exact_grid(mesh, box_distance(half), 0.03))
    mirror = np.diag([1.0, -1.0, 1.0, 1.0])
    left = inverse_pose(mirror @ T_hand_rod @ mirror)  # the rod is its own mirror image
    q[[0, 4, 8]] *= spread
    placed = [[Placed(rod, left, q)]]
    found = check_frames(hand, placed, [], np.eye(4))
    assert found.share == 0 and "mirror image of allegro" in found.hint and found.hinted_share == 1
    right = [[Placed(rod, inverse_pose(T_hand_rod), np.where(np.isin(np.arange(16), [0, 4, 8]), 0.3, q))]]
    assert check_frames(hand, right, [], np.eye(4)).share == 1


def transposed(T, q):
    T = T.copy()
    T[:3, :3] = T[:3, :3].T
    return T, q


def moving_axes(T, q):
    """What a reader of fixed axes makes of angles that turn about moving ones."""
    T = T.copy()
    T[:3, :3] = Rotation.from_euler("xyz", Rotation.from_matrix(T[:3, :3]).as_euler("XYZ")).as_matrix()
    return T, q


@pytest.mark.parametrize(("change", "hint"), [(transposed, "transpose them"), (moving_axes, "moving axes")])
def test_wrong_rotations_are_recognised(clone, capsys, grasps, hand, change, hint):
    foreign_files.dexgraspnet(clone / "g.npy", wrongly(change, grasps[:2]), hand)
    assert hint in refused(capsys, "g.npy", "--object", "block.stl", "--unit", "m")


ISAAC_GYM = [0, 1, 2, 3, 12, 13, 14, 15, 4, 5, 6, 7, 8, 9, 10, 11]
SAPIEN = [0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15]


@pytest.mark.parametrize("order", [ISAAC_GYM, SAPIEN, [12, 13, 14, 15, *range(12)]])
def test_another_order_of_joints_without_names_is_recognised(clone, capsys, grasps, hand, order):
    poses = [in_mesh_frame(own).T_object_hand[0] for own in grasps[:2]]
    np.savez(clone / "g.npz", pose=np.array(poses), q=np.array([own.q[order] for own in grasps[:2]]))
    names = ",".join(hand.joint_names[joint] for joint in order)
    assert f"add --joints {names}" in refused(capsys, "g.npz", "--object", "block.stl", "--unit", "m")
    options = ("--joints", names, "--engine", "sapien", "--most", "1")
    assert scored("g.npz", "--object", "block.stl", "--unit", "m", *options)["verdict"].tolist() == ["holds"]


def test_the_other_order_of_quaternions_is_recognised(clone, capsys, grasps, hand):
    foreign_files.own_json(clone / "g.json", [in_mesh_frame(own) for own in grasps[:2]], hand, order="xyzw")
    assert "add --quaternion xyzw" in refused(capsys, "g.json", "--object", "block.stl", "--unit", "m")
    table = scored("g.json", "--object", "block.stl", "--unit", "m", "--quaternion", "xyzw", "--engine", "sapien")
    assert table["verdict"].tolist() == ["holds", "holds"]


def test_a_grasp_that_touches_is_not_called_wrong(clone, grasps, hand):
    mesh = trimesh.creation.box([0.042] * 3)
    block = prepared("block", mesh, **exact_grid(mesh, box_distance(np.full(3, 0.021)), 0.03))
    placed = [[Placed(block, own.T_object_hand[0], own.q)] for own in grasps]
    found = check_frames(hand, placed, [], np.eye(4))
    assert found.share == pytest.approx(2 / 3) and found.hint == ""


def test_fingers_that_touch_hold(clone, grasps, hand):
    mesh = trimesh.creation.box([0.042] * 3)
    block = prepared("block", mesh, **exact_grid(mesh, box_distance(np.full(3, 0.021)), 0.03))
    settings = read_parameters().synthesize
    own = grasps[0]
    found = assign(hand, block, own.T_object_hand[0], own.q, Hold(np.eye(4)), settings)
    assert found.style == "pinch" and "thumb" in found.fingers and "middle" in found.fingers
    said = assign(hand, block, own.T_object_hand[0], own.q, Hold(np.eye(4), ("thumb", "middle", "ring")), settings)
    assert set(said.fingers) == {"thumb", "middle", "ring"} and len(said.contacts.candidates[0]) == 3


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["missing.json", "--object", "block.stl"], "missing.json is missing"),
        (["g.json", "--object", "missing.stl"], "missing.stl is missing"),
        (
            ["g.json", "--object", "block.stl", "--object", "block.stl", "--unit", "m"],
            "1 object; give --object that many times",
        ),
        (["g.json", "--object", "block.stl", "--hand", "nobody"], "no hand 'nobody'"),
        (["g.json", "--object", "block.stl", "--joints", "a,b"], "--joints names 2 joints for 16 values"),
    ],
)
def test_what_cannot_be_scored_is_told_in_one_sentence(clone, capsys, grasps, hand, arguments, words):
    foreign_files.own_json(clone / "g.json", [in_mesh_frame(grasps[0])], hand)
    assert words in refused(capsys, *arguments)
    assert not (clone / "scores").exists()
