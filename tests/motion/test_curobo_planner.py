"""What cuRobo is told, and what becomes of its answers. cuRobo itself needs a GPU and was not there."""

from __future__ import annotations

import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from types import ModuleType, SimpleNamespace

import coal
import numpy as np
import pinocchio as pin
import pytest
import torch

from pipeline.hand.model import load_hand
from pipeline.hand.robot import ARM_JOINT_NAMES, ARM_LINKS
from pipeline.motion.arm_model import ArmModel
from pipeline.motion.balls import covering_balls, hull_points
from pipeline.motion.collisions import CollisionWorld, Obstacle, box_shape, convex_shape
from pipeline.motion.curobo_planner import curobo, robot_description, scene_description
from pipeline.motion.paths import plan
from pipeline.motion.planners import own, planner
from pipeline.records.errors import UserError

HAND = np.array([0, 0.7, 0, 0.4] * 3 + [1, 0, 0, 0.0])
START = np.array([-0.14377, -0.41616, 0.15588, -2.79922, 0.09157, 2.38554, 1.50301])


def at(x: float, y: float, z: float) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


@pytest.fixture(scope="module")
def arm() -> ArmModel:
    return ArmModel(HAND, load_hand("allegro"))


@pytest.fixture(scope="module")
def wall_world(arm: ArmModel) -> tuple[CollisionWorld, np.ndarray, np.ndarray]:
    """A wall that the straight line from left to right runs into."""
    left, right = START.copy(), START.copy()
    left[0], right[0] = 0.7, -0.7
    wall = Obstacle("wall", (box_shape([0.3, 0.02, 0.35]),), at(0.55, 0, 0.175))
    return CollisionWorld(arm, [wall], margin=0.003), left, right


@pytest.mark.parametrize("size", [(0.02, 0.027, 0.05), (0.1, 0.1, 0.3), (0.001, 0.2, 0.1), (0.3, 0.3, 0.3)])
def test_balls_cover_a_box_and_stand_out_little(size: tuple[float, float, float]) -> None:
    balls = covering_balls(box_shape(size))
    half = np.array(size) / 2
    points = np.random.default_rng(0).uniform(-half, half, (2000, 3))
    distance = np.linalg.norm(points[:, None] - balls[None, :, :3], axis=2) - balls[:, 3]
    assert distance.min(axis=1).max() <= 1e-9
    out = (np.abs(balls[:, :3]) + balls[:, 3:] - half).max()
    assert out <= 0.04 * np.sqrt(3) / 2


def test_a_ball_is_itself_and_a_round_shape_nearly_covered() -> None:
    np.testing.assert_array_equal(covering_balls(coal.Sphere(0.02)), [[0, 0, 0, 0.02]])
    points = np.random.default_rng(1).normal(size=(400, 3))
    points *= 0.05 / np.linalg.norm(points, axis=1, keepdims=True)
    found = covering_balls(convex_shape(points))
    distance = np.linalg.norm(points[:, None] - found[None, :, :3], axis=2) - found[:, 3]
    assert distance.min(axis=1).max() < 0.25 * 0.04
    assert (np.linalg.norm(found[:, :3], axis=1) + found[:, 3]).max() < 0.05 + 0.04


def balls_in_world(arm: ArmModel, description: dict, q: np.ndarray) -> np.ndarray:
    """Balls (n, 4) of a description at arm joints ``q``, by the kinematics of Pinocchio."""
    data = arm.model.createData()
    pin.forwardKinematics(arm.model, data, q)
    found = []
    for link, balls in description["robot_cfg"]["kinematics"]["collision_spheres"].items():
        T = data.oMi[ARM_LINKS.index(link)].homogeneous
        found += [[*(T[:3, :3] @ ball["center"] + T[:3, 3]), ball["radius"]] for ball in balls]
    return np.array(found)


def distance_to_box(points: np.ndarray, centre: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Distance (n,) of points (n, 3) from a box along the axes; 0 in it."""
    return np.linalg.norm(np.maximum(np.abs(points - centre) - half, 0), axis=1)


def test_where_the_robot_hits_a_block_its_balls_do(arm: ArmModel) -> None:
    rng = np.random.default_rng(2)
    pole = Obstacle("pole", (box_shape([0.03, 0.03, 0.2]),), at(0.1, 0, 0))
    description = robot_description(arm, [pole], 0.0, "arm.urdf")
    half = np.array([0.1, 0.1, 0.1])
    hits = 0
    for q in rng.uniform(arm.lower, arm.upper, (60, 7)):
        centre = np.array([*rng.uniform(-0.6, 0.6, 2), rng.uniform(0.3, 0.9)])
        block = Obstacle("block", (box_shape(2 * half),), at(*centre))
        # without the arm's own collisions: those with the block alone
        if CollisionWorld(arm, [], [pole]).is_free(q) and not CollisionWorld(arm, [block], [pole]).is_free(q):
            balls = balls_in_world(arm, description, q)
            assert (distance_to_box(balls[:, :3], centre, half) - balls[:, 3]).min() < 0.005
            hits += 1
    assert hits >= 5


def test_the_description_names_what_curobo_asks_for(arm: ArmModel) -> None:
    kinematics = robot_description(arm, [], 0.003, "arm.urdf")["robot_cfg"]["kinematics"]
    links = kinematics["collision_link_names"]
    assert links == list(ARM_LINKS[1:]) and set(kinematics["collision_spheres"]) == set(links)
    assert kinematics["cspace"]["joint_names"] == list(ARM_JOINT_NAMES)
    assert kinematics["self_collision_ignore"]["panda_link3"] == ["panda_link4", "panda_link5"]
    assert kinematics["collision_sphere_buffer"] == 0.003


def test_the_scene_has_boxes_and_hulls_where_they_stand() -> None:
    corners = hull_points(box_shape([0.1, 0.1, 0.1]))
    thing = Obstacle("object0", (convex_shape(corners), box_shape([0.2, 0.4, 0.6])), at(1, 2, 3))
    scene = scene_description([thing])
    assert scene["cuboid"] == {"object0_1": {"dims": [0.2, 0.4, 0.6], "pose": [1, 2, 3, 1, 0, 0, 0]}}
    mesh = scene["mesh"]["object0_0"]
    np.testing.assert_allclose(np.ptp(mesh["vertices"], axis=0), 0.1)
    assert mesh["pose"] == [1, 2, 3, 1, 0, 0, 0] and len(mesh["faces"]) == 12
    assert scene_description([]) == {}


class StandIn:
    """A module with the shapes and names of cuRobo 0.8, whose planner returns a path that it is told."""

    def __init__(self, answer: Callable[[np.ndarray, np.ndarray], np.ndarray | None], order: list[int]) -> None:
        self.settings: dict = {}
        names = [ARM_JOINT_NAMES[index] for index in order]

        class JointState(SimpleNamespace):
            @staticmethod
            def from_position(position: torch.Tensor, joint_names: list[str]) -> JointState:
                assert position.shape == (1, 7) and joint_names == names
                return JointState(position=position, joint_names=joint_names)

        def create(**settings) -> dict:
            self.settings = settings
            return settings

        class MotionPlanner:
            joint_names = names
            device_cfg = SimpleNamespace(device=torch.device("cpu"))

            def __init__(self, settings: dict) -> None:
                assert set(settings) == {"robot", "scene_model", "random_seed", "use_cuda_graph"}

            def plan_cspace(self, goal_state: JointState, current_state: JointState):
                path = answer(current_state.position[0].numpy(), goal_state.position[0].numpy())
                success = torch.tensor([[path is not None]])
                position = None if path is None else torch.tensor(path, dtype=torch.float32)[None, None]
                return SimpleNamespace(success=success, get_interpolated_plan=lambda: JointState(position=position))

        self.motion_planner = ModuleType("curobo.motion_planner")
        self.motion_planner.MotionPlannerCfg = SimpleNamespace(create=create)
        self.motion_planner.MotionPlanner = MotionPlanner
        self.types = ModuleType("curobo.types")
        self.types.JointState = JointState

    def install(self, monkeypatch: pytest.MonkeyPatch) -> None:
        package = ModuleType("curobo")
        package.motion_planner, package.types = self.motion_planner, self.types
        for name, module in (("", package), (".motion_planner", self.motion_planner), (".types", self.types)):
            monkeypatch.setitem(sys.modules, f"curobo{name}", module)


ORDER = [3, 0, 1, 2, 6, 5, 4]  # in which the stand-in names the joints


def test_a_free_path_is_taken_in_our_order_of_joints(wall_world, arm: ArmModel, monkeypatch) -> None:
    world, left, right = wall_world
    around = plan(world.is_free, left, right, arm.lower, arm.upper, np.random.default_rng(0))
    assert around is not None and len(around) > 2
    asked = []

    def answer(start: np.ndarray, goal: np.ndarray) -> np.ndarray:
        asked.append((start, goal))
        return around[:, ORDER]

    stand_in = StandIn(answer, ORDER)
    stand_in.install(monkeypatch)
    path = curobo(world, left, right, np.random.default_rng(0))
    assert path is not None
    np.testing.assert_array_equal(path[[0, -1]], [left, right])
    np.testing.assert_allclose(path, around, atol=1e-6)
    np.testing.assert_allclose(asked[0], [left[ORDER], right[ORDER]], atol=1e-6)
    assert set(stand_in.settings["scene_model"]["cuboid"]) == {"wall_0"}
    links = {link.get("name") for link in ElementTree.parse(urdf_of(stand_in)).getroot().iter("link")}
    assert links == set(ARM_LINKS)


def urdf_of(stand_in: StandIn) -> str:
    return stand_in.settings["robot"]["robot_cfg"]["kinematics"]["urdf_path"]


def test_a_path_through_the_wall_is_refused_whatever_curobo_says(wall_world, monkeypatch) -> None:
    world, left, right = wall_world
    StandIn(lambda start, goal: np.linspace(start, goal, 21), list(range(7))).install(monkeypatch)
    assert curobo(world, left, right, np.random.default_rng(0)) is None
    StandIn(lambda start, goal: None, list(range(7))).install(monkeypatch)
    assert curobo(world, left, right, np.random.default_rng(0)) is None


def test_the_seed_comes_from_the_trial(wall_world, monkeypatch) -> None:
    world, left, right = wall_world
    seeds = []
    for number in (0, 0, 1):
        stand_in = StandIn(lambda start, goal: None, list(range(7)))
        stand_in.install(monkeypatch)
        curobo(world, left, right, np.random.default_rng(number))
        seeds.append(stand_in.settings["random_seed"])
    assert seeds[0] == seeds[1] != seeds[2]


def test_without_curobo_one_sentence_says_so(wall_world, monkeypatch) -> None:
    world, left, right = wall_world
    for module in ("curobo", "curobo.motion_planner", "curobo.types"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(UserError, match=r"evaluate\.planner is curobo, but cuRobo 2 is not installed here; .*own\.$"):
        planner("curobo")(world, left, right, np.random.default_rng(0))


def test_without_a_gpu_one_sentence_says_so(wall_world, monkeypatch) -> None:
    world, left, right = wall_world
    stand_in = StandIn(lambda start, goal: None, list(range(7)))

    def no_gpu(settings: dict) -> None:
        raise RuntimeError("Found no NVIDIA driver on your system.\nPlease check ...")

    stand_in.motion_planner.MotionPlanner = no_gpu
    stand_in.install(monkeypatch)
    with pytest.raises(UserError, match=r"cannot start here \(Found no NVIDIA driver on your system\.\); it needs"):
        curobo(world, left, right, np.random.default_rng(0))


def test_own_is_the_planner_of_this_project(wall_world, arm: ArmModel) -> None:
    world, left, right = wall_world
    assert planner("own") is own
    expected = plan(world.is_free, left, right, arm.lower, arm.upper, np.random.default_rng(5))
    np.testing.assert_array_equal(own(world, left, right, np.random.default_rng(5)), expected)


PROGRAM = """
import numpy as np
from tests.motion.test_curobo_planner import HAND, START
from pipeline.hand.model import load_hand
from pipeline.motion.arm_model import ArmModel
from pipeline.motion.collisions import CollisionWorld
from pipeline.motion.curobo_planner import curobo
goal = START.copy()
goal[[0, 3]] += 0.4, 0.2
world = CollisionWorld(ArmModel(HAND, load_hand("allegro")), [])
print(np.array2string(curobo(world, START, goal, np.random.default_rng(0))[[0, -1]] - [START, goal]))
"""


@pytest.mark.slow
def test_another_implementation_of_the_interface_takes_what_we_tell_it(repository, tmp_path) -> None:
    """curobo-metal 1.0.1 has cuRobo's interface and runs on a CPU; it is put into a folder of its own."""
    fetch = ["uv", "pip", "install", "--quiet", "--no-deps", "--target", str(tmp_path), "curobo-metal==1.0.1"]
    try:
        done = subprocess.run(fetch, capture_output=True, text=True, timeout=120)
    except (FileNotFoundError, subprocess.TimeoutExpired):
        pytest.skip("it cannot be fetched here")
    if done.returncode:
        pytest.skip(f"it cannot be fetched here: {done.stderr.strip()[-200:]}")
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path[:0] = [{str(repository)!r}, {str(tmp_path)!r}]\n{PROGRAM}"],
        cwd=repository,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert np.fromstring(done.stdout.replace("[", " ").replace("]", " "), sep=" ").tolist() == [0.0] * 14
