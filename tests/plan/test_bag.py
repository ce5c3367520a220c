"""A plan as a ROS 2 bag: read by rosbags, and by mcap's own decoder, which knows nothing of the writer."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation

from pipeline.evaluate.scene import START_ARM
from pipeline.hand.robot import robot_joint_names
from pipeline.motion.arm_model import ArmModel
from pipeline.plan.bag import KINDS, START, main
from pipeline.plan.messages import message_types
from pipeline.records.objects import write_prepared_object
from pipeline.records.paths import prepared_folder
from tests.evaluate.conftest import HAND

STEP = 0.1  # s
CUBE = np.array([0.5, 0.1, 0.12])  # m
PHASES = ("approach first", "close first", "lift first", "close second", "lift second", "hold")


@pytest.fixture(scope="module")
def content() -> dict:
    """Thirteen way-points in which the arm turns about its base from the third phase on."""
    q = np.tile(np.concatenate([START_ARM, HAND.start]), (13, 1))
    q[5:, 0] += np.linspace(0, 0.35, 8)
    names = ["home", *(name for name in PHASES for _ in range(2))]
    T = np.eye(4)
    T[:3, 3] = CUBE
    other = T.copy()
    other[1, 3] = -0.1
    return {
        "joint_names": list(robot_joint_names(HAND)),
        "within_limits": True,
        "objects": [{"name": "cube", "T_world_object": T.tolist()}, {"name": "can", "T_world_object": other.tolist()}],
        "others": [],
        "phases": [
            {"name": name, "begin": 2 * number * STEP, "end": 2 * (number + 1) * STEP}
            for number, name in enumerate(PHASES)
        ],
        "waypoints": [
            {"time": STEP * row, "phase": name, "position": q[row].tolist(), "arm_velocity": [0.5] + [0.0] * 6}
            for row, name in enumerate(names)
        ],
    }


@pytest.fixture
def bag(empty_folder, repository, content, objects) -> Path:
    (empty_folder / "params.yaml").write_text((repository / "params.yaml").read_text())
    write_prepared_object(prepared_folder("cube"), objects[0])
    (empty_folder / "plan").mkdir()
    (empty_folder / "plan/plan.json").write_text(json.dumps(content))
    assert main(["plan/plan.json"]) == 0
    return empty_folder / "plan/bag"


def decoded(bag: Path) -> dict[str, list]:
    """Topic -> (s, message), by mcap's decoder."""
    found: dict[str, list] = {topic: [] for topic in KINDS}
    with (bag / "bag.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, ros in reader.iter_decoded_messages():
            found[channel.topic].append((message.log_time / 1e9 - START, ros))
    return found


def test_both_readers_find_the_plan(bag, content):
    q = np.array([point["position"] for point in content["waypoints"]])
    found = decoded(bag)
    arm, hand = (found[f"/{part}/joint_trajectory"][0][1] for part in ("arm", "hand"))
    assert list(arm.joint_names) + list(hand.joint_names) == content["joint_names"]
    np.testing.assert_array_equal([list(point.positions) for point in arm.points], q[:, :7])
    np.testing.assert_array_equal([list(point.positions) for point in hand.points], q[:, 7:])
    since = [point.time_from_start.sec + point.time_from_start.nanosec / 1e9 for point in arm.points]
    np.testing.assert_allclose(since, STEP * np.arange(13), atol=1e-9)
    assert [message.data for _, message in found["/phase"]] == list(PHASES)
    with AnyReader([bag], default_typestore=message_types()) as reader:
        assert {connection.topic: connection.msgtype for connection in reader.connections} == KINDS
        states = [
            reader.deserialize(raw, connection.msgtype)
            for connection, _, raw in reader.messages()
            if connection.topic == "/joint_states"
        ]
    np.testing.assert_array_equal([state.position for state in states], q)


def test_frames_are_where_independent_kinematics_has_them(bag, content):
    """The palm through all frames from the base, against the reduced arm model that plans motions."""
    found = decoded(bag)
    fixed = {one.child_frame_id: one for one in found["/tf_static"][0][1].transforms}
    for (_, message), point in zip(found["/tf"], content["waypoints"], strict=True):
        frames = fixed | {one.child_frame_id: one for one in message.transforms}
        q = np.array(point["position"])
        np.testing.assert_allclose(chain(frames, HAND.root), ArmModel(q[7:], HAND).hand_pose(q[:7]), atol=1e-9)


def chain(frames: dict, name: str) -> np.ndarray:
    T = np.eye(4)
    while name in frames:
        one = frames[name]
        step = np.eye(4)
        move, turn = one.transform.translation, one.transform.rotation
        step[:3, :3] = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
        step[:3, 3] = [move.x, move.y, move.z]
        T, name = step @ T, one.header.frame_id
    assert name == "panda_link0"
    return T


def test_an_object_moves_with_the_hand_once_it_is_lifted(bag, content):
    found = decoded(bag)
    places = [
        chain({one.child_frame_id: one for one in m.transforms if one.child_frame_id == "cube"}, "cube")
        for _, m in found["/tf"]
    ]
    np.testing.assert_allclose(places[4][:3, 3], CUBE)
    turn = 0.35  # about the base's vertical axis, with the arm
    expected = [
        np.cos(turn) * CUBE[0] - np.sin(turn) * CUBE[1],
        np.sin(turn) * CUBE[0] + np.cos(turn) * CUBE[1],
        CUBE[2],
    ]
    np.testing.assert_allclose(places[-1][:3, 3], expected, atol=1e-9)


def test_the_planning_scene_begins_with_everything_and_attaches_what_is_lifted(bag):
    scenes = decoded(bag)["/planning_scene"]
    first = scenes[0][1]
    things = {thing.id: thing for thing in first.world.collision_objects}
    assert list(things) == ["sponge", "table", "cube", "can"] and not first.is_diff
    assert len(things["cube"].meshes[0].triangles) == 12
    assert things["cube"].pose.position.x == pytest.approx(CUBE[0])
    assert [
        (round(time, 6), scene.robot_state.attached_collision_objects[0].object.id) for time, scene in scenes[1:]
    ] == [
        (0.4, "cube"),
        (0.8, "can"),
    ]
    assert all(scene.is_diff and scene.world.collision_objects[0].operation == 1 for _, scene in scenes[1:])


def test_the_layout_shows_topics_that_are_there(bag):
    layout = json.loads((bag.parent / "foxglove.json").read_text())
    assert set(layout["configById"]["3D!plan"]["topics"]) <= set(KINDS)
    paths = [path["value"].split(".")[0] for path in layout["configById"]["Plot!arm"]["paths"]]
    assert set(paths) == {"/joint_states"} and len(paths) == 7


def test_a_second_run_replaces_the_bag(bag):
    before = decoded(bag)["/joint_states"][0][1].position
    assert main(["plan/plan.json"]) == 0
    np.testing.assert_array_equal(decoded(bag)["/joint_states"][0][1].position, before)
    assert sorted(path.name for path in bag.parent.iterdir()) == ["bag", "foxglove.json", "plan.json"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c: c.pop("waypoints"), "is damaged or no plan"),
        (lambda c: c.update(within_limits=False), "breaks a limit"),
        (lambda c: c["waypoints"].pop(), None),
        (lambda c: c["waypoints"][3].update(position=[0.0]), "is damaged or no plan"),
        (lambda c: c.update(waypoints=c["waypoints"][:1]), "too few way-points"),
    ],
)
def test_what_is_no_plan_is_refused_in_one_sentence(empty_folder, repository, content, capsys, change, words):
    (empty_folder / "params.yaml").write_text((repository / "params.yaml").read_text())
    changed = json.loads(json.dumps(content))
    change(changed)
    (empty_folder / "plan.json").write_text(json.dumps(changed))
    if words is None:
        assert main(["plan.json"]) == 0
        return
    assert main(["plan.json"]) == 2
    error = capsys.readouterr().err
    assert words in error and error.count("\n") == 1
    assert not (empty_folder / "bag").exists()
