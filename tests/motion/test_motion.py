from __future__ import annotations

import numpy as np
import pytest

from pipeline.hand.kinematics import link_poses
from pipeline.hand.model import load_hand
from pipeline.motion.arm_model import ARM_ACCELERATION, ArmModel
from pipeline.motion.collisions import CollisionWorld, Obstacle, box_shape, convex_shape
from pipeline.motion.inverse_kinematics import POSITION_TOLERANCE, ROTATION_TOLERANCE, solve, solve_from
from pipeline.motion.paths import hand_line, is_line_free, line, plan, shortcut, without_near_duplicates
from pipeline.motion.timing import LONGEST_MOVE, time_path

ALLEGRO = load_hand("allegro")
HAND = np.array([0, 0.7, 0, 0.4] * 3 + [1, 0, 0, 0.0])
START = np.array([-0.14377, -0.41616, 0.15588, -2.79922, 0.09157, 2.38554, 1.50301])


def at(x: float, y: float, z: float) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


def rotation_angle(R: np.ndarray) -> float:
    return float(np.arccos(np.clip((np.trace(R) - 1) / 2, -1, 1)))


@pytest.fixture(scope="module")
def arm() -> ArmModel:
    return ArmModel(HAND, ALLEGRO)


@pytest.fixture(scope="module")
def table() -> Obstacle:
    return Obstacle("table", (box_shape([2, 2, 0.1]),), at(0.5, 0, -0.05))


def denavit_hartenberg(q: np.ndarray) -> np.ndarray:
    """Base to link 7 with the parameters (Craig's convention) of Franka's documentation."""
    T = np.eye(4)
    parameters = [
        (0, 0.333, 0), (0, 0, -np.pi / 2), (0, 0.316, np.pi / 2), (0.0825, 0, np.pi / 2),
        (-0.0825, 0.384, -np.pi / 2), (0, 0, np.pi / 2), (0.088, 0, np.pi / 2),
    ]  # fmt: skip
    for (a, d, alpha), angle in zip(parameters, q, strict=True):
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
        T = T @ np.array([[c, -s, 0, a], [s * ca, c * ca, -sa, -d * sa], [s * sa, c * sa, ca, d * ca], [0, 0, 0, 1]])
    return T


def test_hand_pose_agrees_with_the_published_kinematics(arm: ArmModel) -> None:
    rng = np.random.default_rng(0)
    for q in rng.uniform(arm.lower, arm.upper, (20, 7)):
        np.testing.assert_allclose(arm.hand_pose(q), denavit_hartenberg(q) @ ALLEGRO.mount.T_link7_hand, atol=1e-5)


def test_hand_shapes_stand_where_the_hand_room_says(arm: ArmModel) -> None:
    hand = ALLEGRO
    poses = link_poses(hand, HAND[None])[0]
    T_hand_joint = np.linalg.inv(arm.T_link7_hand)
    shapes = {item.name: item for item in arm.geometry.geometryObjects}
    for link, pose in zip(hand.box_link, hand.box_pose, strict=True):
        name = hand.link_names[link]
        if name == "base_link":
            continue
        np.testing.assert_allclose(
            T_hand_joint @ shapes[f"{name}_0"].placement.homogeneous, poses[link] @ pose, atol=1e-6
        )


def test_jacobian_agrees_with_finite_differences(arm: ArmModel) -> None:
    rng = np.random.default_rng(1)
    q = rng.uniform(arm.lower, arm.upper)
    T = arm.hand_pose(q)
    _, J = arm.pose_errors(T)(q)
    for joint in range(7):
        moved = q.copy()
        moved[joint] += 1e-6
        error, _ = arm.pose_errors(arm.hand_pose(moved))(q)
        np.testing.assert_allclose(error / 1e-6, J[:, joint], atol=1e-5)


def test_inverse_kinematics_finds_reachable_poses_within_limits(arm: ArmModel) -> None:
    rng = np.random.default_rng(2)
    solved = 0
    for q in rng.uniform(arm.lower * 0.8, arm.upper * 0.8, (20, 7)):
        q = np.clip(q, arm.lower, arm.upper)
        goal = arm.hand_pose(q)
        for solution in solve(arm, goal, START, rng, accept=lambda _: True):
            reached = arm.hand_pose(solution)
            assert np.linalg.norm(reached[:3, 3] - goal[:3, 3]) < POSITION_TOLERANCE * 1.01
            assert rotation_angle(reached[:3, :3].T @ goal[:3, :3]) < ROTATION_TOLERANCE * 1.01
            assert np.all(solution >= arm.lower) and np.all(solution <= arm.upper)
            solved += 1
    assert solved >= 20


def test_inverse_kinematics_refuses_what_is_out_of_reach(arm: ArmModel) -> None:
    assert solve(arm, at(2.0, 0, 0.5), START, np.random.default_rng(0), accept=lambda _: True, restarts=5) == []
    assert solve_from(arm, at(0, 0, 2.0), START) is None


def test_inverse_kinematics_obeys_the_test_of_solutions(arm: ArmModel) -> None:
    goal = arm.hand_pose(START)
    rng = np.random.default_rng(0)
    assert solve(arm, goal, START, rng, accept=lambda _: False, restarts=5) == []
    assert all(q[0] < -0.5 for q in solve(arm, goal, START, rng, accept=lambda q: bool(q[0] < -0.5)))


def lowest_hand_point(T_base_hand: np.ndarray) -> float:
    """From the boxes and tip balls of the hand room."""
    hand = ALLEGRO
    poses = T_base_hand @ link_poses(hand, HAND[None])[0]
    corners = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), -1).reshape(-1, 3)
    heights = [
        (poses[link] @ pose @ np.r_[corner * half, 1])[2]
        for link, pose, half in zip(hand.box_link, hand.box_pose, hand.box_half, strict=True)
        for corner in corners
    ]
    tips = [(T_base_hand @ link_poses(hand, HAND[None])[0][link])[2, 3] - 0.012 for link in hand.sphere_link]
    return min(heights + tips)


@pytest.mark.parametrize(
    ("gap", "margin", "free"), [(0.002, 0, True), (-0.002, 0, False), (0.004, 0.006, False), (0.008, 0.006, True)]
)
def test_hand_hits_a_block_exactly_when_it_reaches_it(arm: ArmModel, gap: float, margin: float, free: bool) -> None:
    top = lowest_hand_point(arm.hand_pose(START)) - gap
    block = Obstacle("block", (box_shape([0.6, 0.6, 0.02]),), at(0.5, 0, top - 0.01))
    assert CollisionWorld(arm, [block], margin=margin).is_free(START) == free


def test_arm_hits_itself_when_folded(arm: ArmModel) -> None:
    world = CollisionWorld(arm, [])
    assert world.is_free(START)
    folded = np.array([0.0, -1.7, 0.0, -3.07, 0.0, 0.0, 0.0])
    assert not world.is_free(folded)


def test_held_object_collides_and_grasped_object_may_be_touched(arm: ArmModel, table: Obstacle) -> None:
    pole = Obstacle("pole", (box_shape([0.02, 0.02, 0.4]),))
    T_base_hand = arm.hand_pose(START)
    below = np.linalg.inv(T_base_hand) @ at(0.5, 0, 0.1)  # reaches 10 cm into the table
    assert not CollisionWorld(arm, [table], held=[pole.at(below)]).is_free(START)
    assert CollisionWorld(arm, [table]).is_free(START)
    ball = Obstacle("ball", (box_shape([0.03] * 3),), T_base_hand)
    assert not CollisionWorld(arm, [ball]).is_free(START)
    assert CollisionWorld(arm, [ball], allowed=["ball"]).is_free(START)


def test_convex_shape_is_the_hull() -> None:
    corners = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), -1).reshape(-1, 3) * 0.1
    inside = np.random.default_rng(0).uniform(-0.09, 0.09, (40, 3))
    assert convex_shape(np.concatenate([corners, inside])).num_points == 8


def wall_between(arm: ArmModel, margin: float = 0.003) -> tuple[CollisionWorld, np.ndarray, np.ndarray]:
    """A wall that the straight line from left to right runs into; the way over it is open."""
    left, right = START.copy(), START.copy()
    left[0], right[0] = 0.7, -0.7
    wall = Obstacle("wall", (box_shape([0.3, 0.02, 0.35]),), at(0.55, 0, 0.175))
    return CollisionWorld(arm, [wall], margin=margin), left, right


def test_planner_goes_around_a_wall_the_same_way_every_time(arm: ArmModel) -> None:
    world, left, right = wall_between(arm)
    assert not is_line_free(world.is_free, left, right)
    paths = [plan(world.is_free, left, right, arm.lower, arm.upper, np.random.default_rng(seed)) for seed in (0, 0, 1)]
    touching, _, _ = wall_between(arm, margin=0.0)
    for path in paths:
        assert path is not None
        np.testing.assert_array_equal(path[[0, -1]], [left, right])
        for a, b in zip(path[:-1], path[1:], strict=True):
            assert touching.all_free(line(a, b, 0.002))
    np.testing.assert_array_equal(paths[0], paths[1])
    assert paths[0].shape != paths[2].shape or np.abs(paths[0] - paths[2]).max() > 0


def test_planner_prefers_the_straight_line_and_refuses_bad_ends(arm: ArmModel) -> None:
    world, left, right = wall_between(arm)
    rng = np.random.default_rng(0)
    near = left + 0.1
    assert len(plan(world.is_free, left, near, arm.lower, arm.upper, rng)) == 2
    into = left.copy()
    into[0] = 0.0
    assert not world.is_free(into)
    assert plan(world.is_free, left, into, arm.lower, arm.upper, rng) is None
    assert plan(world.is_free, into, left, arm.lower, arm.upper, rng) is None


def test_shortcut_never_lengthens(arm: ArmModel) -> None:
    rng = np.random.default_rng(0)
    path = rng.uniform(arm.lower, arm.upper, (8, 7))
    shorter = shortcut(lambda q: True, path, rng)

    def length(points: np.ndarray) -> float:
        return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())

    assert length(shorter) <= length(path) + 1e-9
    np.testing.assert_array_equal(shorter[[0, -1]], path[[0, -1]])


def test_near_duplicates_are_dropped() -> None:
    path = np.zeros((5, 7))
    path[:, 0] = [0.0, 0.5, 0.505, 0.995, 1.0]
    np.testing.assert_array_equal(without_near_duplicates(path)[:, 0], [0.0, 0.5, 1.0])


def test_hand_line_is_straight_and_keeps_the_orientation(arm: ArmModel) -> None:
    path = hand_line(arm, START, [0.02, -0.03, 0.1], lambda q: True)
    assert path is not None
    begin = arm.hand_pose(START)
    share = np.linspace(0, 1, len(path))
    for s, q in zip(share, path, strict=True):
        T = arm.hand_pose(q)
        np.testing.assert_allclose(T[:3, 3], begin[:3, 3] + s * np.array([0.02, -0.03, 0.1]), atol=3e-4)
        assert rotation_angle(T[:3, :3].T @ begin[:3, :3]) < 2e-3
    assert hand_line(arm, START, [0, 0, 2.0], lambda q: True) is None
    assert hand_line(arm, START, [0, 0, 0.1], lambda q: False) is None


@pytest.mark.parametrize("share", [(0.5, 0.5), (0.25, 0.1)])
def test_timing_keeps_the_limits_and_ends_at_rest(arm: ArmModel, share: tuple[float, float]) -> None:
    world, left, right = wall_between(arm)
    path = plan(world.is_free, left, right, arm.lower, arm.upper, np.random.default_rng(3))
    assert path is not None
    motion = time_path(arm, path, 200.0, *share)
    if share == (0.5, 0.5):
        assert motion is not None
    if motion is None:
        return
    assert motion.duration <= LONGEST_MOVE + 0.01
    np.testing.assert_array_equal(motion.positions[[0, -1]], path[[0, -1]])
    np.testing.assert_allclose(motion.velocities[[0, -1]], 0.0, atol=1e-6)
    assert np.all(np.abs(motion.velocities) <= share[0] * arm.velocity * 1.01)
    acceleration = np.diff(motion.velocities[:-1], axis=0) * 200.0
    assert np.quantile(np.abs(acceleration) / (share[1] * ARM_ACCELERATION), 0.99) <= 1.05
    central = (motion.positions[2:-1] - motion.positions[:-3]) * 100.0
    np.testing.assert_allclose(central, motion.velocities[1:-2], atol=0.05)
    assert world.all_free(motion.positions)


def test_timing_of_one_joint_is_the_trapezium(arm: ArmModel) -> None:
    goal = START.copy()
    goal[0] += 1.0
    motion = time_path(arm, np.array([START, goal]), 100.0, 0.5, 0.5)
    assert motion is not None
    velocity, acceleration = 0.5 * arm.velocity[0], 0.5 * ARM_ACCELERATION[0]
    exact = 1.0 / velocity + velocity / acceleration
    assert exact <= motion.duration <= exact + 0.03


def test_timing_refuses_what_takes_too_long_and_accepts_no_motion(arm: ArmModel) -> None:
    goal = START.copy()
    goal[0] += 1.0
    assert time_path(arm, np.array([START, goal]), 50.0, 0.02, 0.5) is None
    still = time_path(arm, np.array([START, START]), 50.0, 0.5, 0.5)
    assert still is not None and still.duration == 0.0
