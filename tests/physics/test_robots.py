from itertools import combinations, product

import numpy as np
import pytest

from pipeline.hand.kinematics import link_poses
from pipeline.hand.model import load_hand
from pipeline.hand.robot import robot_file, robot_joint_names
from pipeline.physics.engine import pressing_links, steps_in
from pipeline.physics.world import make_world
from pipeline.records.hands import known_hands
from tests.physics.engines import in_both, settings

HAND = load_hand("allegro")
ARM_REST = np.array([0, 0, 0, -np.pi / 2, 0, np.pi / 2, 0])


def random_pose(rng: np.random.Generator) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    T = np.eye(4)
    T[:3, :3] = Rotation.random(rng=rng).as_matrix()
    T[:3, 3] = rng.normal(size=3) * 0.1
    return T


@in_both
@pytest.mark.parametrize("name", known_hands())
def test_hand_forward_kinematics_agree_with_the_hand_model(name: str, engine: str) -> None:
    hand = load_hand(name)
    rng = np.random.default_rng(3)
    for _ in range(3):
        q = rng.uniform(hand.lower, hand.upper)
        T_world_hand = random_pose(rng)
        robot = make_world(settings(engine)).add_hand(hand, T_world_hand, q)
        assert robot.joint_names == hand.joint_names
        np.testing.assert_allclose(robot.q, q, atol=1e-6)
        expected = T_world_hand @ link_poses(hand, q[None])[0]
        for index, link in enumerate(hand.link_names):
            np.testing.assert_allclose(robot.link_pose(link), expected[index], atol=1e-6)


@in_both
def test_arm_and_hand_follow_the_mount_and_the_joint_names(engine: str) -> None:
    rng = np.random.default_rng(4)
    q = np.concatenate([ARM_REST + rng.uniform(-0.3, 0.3, 7), rng.uniform(HAND.lower, HAND.upper)])
    robot = make_world(settings(engine)).add_arm(HAND, q)
    assert robot.joint_names == robot_joint_names(HAND)
    expected = robot.link_pose("panda_link7") @ HAND.mount.T_link7_hand
    np.testing.assert_allclose(robot.link_pose("base_link"), expected, atol=1e-6)
    expected = robot.link_pose("base_link") @ link_poses(HAND, q[None, 7:])[0]
    for index, name in enumerate(HAND.link_names):
        np.testing.assert_allclose(robot.link_pose(name), expected[index], atol=2e-6)


@in_both
@pytest.mark.parametrize("arm", [False, True])
def test_drives_reach_targets_without_gravity_error(arm: bool, engine: str) -> None:
    middle = (HAND.lower + HAND.upper) / 2
    start = np.concatenate([ARM_REST, middle]) if arm else middle
    target = start + 0.1
    world = make_world(settings(engine))
    robot = world.add_arm(HAND, start) if arm else world.add_hand(HAND, np.eye(4), start)
    robot.set_targets(target)
    world.step(steps_in(2.0, world.frequency))
    np.testing.assert_allclose(robot.q, target, atol=2e-3)


@in_both
def test_a_blocked_joint_presses_with_the_torque_limit(engine: str) -> None:
    # index finger straight, tip against a fixed box: force x lever arm of joint_1.0 = hand_torque_limit
    q = np.clip(np.zeros(16), HAND.lower, HAND.upper)
    poses = link_poses(HAND, q[None])[0]
    tip = poses[HAND.link("link_3.0_tip")][:3, 3]
    box = np.eye(4)
    box[:3, 3] = tip + [0.012 + 0.0205, 0, 0.02]  # its lower edge beside the tip's centre
    physics = settings(engine, tip_static_friction=0, tip_dynamic_friction=0, support_friction=0)
    world = make_world(physics, np.zeros(3))
    robot = world.add_hand(HAND, np.eye(4), q)
    support = world.add_box([0.02, 0.02, 0.02], box, "wall")
    target = q.copy()
    target[1] += 0.5
    robot.set_targets(target)
    world.step(steps_in(1.0, world.frequency))
    lever = tip[2] - poses[HAND.link("link_1.0")][2, 3]
    force = support.link_impulses()["link_3.0_tip"] * physics.frequency
    assert pressing_links(support, 0.01) == {"link_3.0_tip"}
    assert force[0] == pytest.approx(physics.hand_torque_limit / lever, rel=0.02)


@in_both
def test_a_test_repeats_bit_for_bit(cube, engine: str) -> None:  # type: ignore[no-untyped-def]
    def run() -> bytes:
        q = (HAND.lower + HAND.upper) / 2
        world = make_world(settings(engine))
        robot = world.add_hand(HAND, np.eye(4), q)
        T = np.eye(4)
        T[:3, 3] = 0.06, 0.0, 0.06
        body = world.add_object(cube, T, "cube")
        robot.set_targets(HAND.upper)
        world.step(150)
        return robot.q.tobytes() + body.pose.tobytes()

    assert run() == run()


def test_ignored_pairs_never_meet() -> None:
    """Smallest distance of every ignored pair of hand links over a grid of the joints between them."""
    import coal
    import pinocchio as pin

    path = str(robot_file(False, HAND))
    model = pin.buildModelFromUrdf(path)
    geometry = pin.buildGeomFromUrdf(model, path, pin.GeometryType.COLLISION)
    shapes: dict[str, list[int]] = {}
    for index, item in enumerate(geometry.geometryObjects):
        if isinstance(item.geometry, coal.BVHModelBase):
            item.geometry.buildConvexHull(True, "Qt")
            item.geometry = item.geometry.convex
        shapes.setdefault(model.frames[item.parentFrame].name, []).append(index)
    data, placed = model.createData(), pin.GeometryData(geometry)

    def ancestors(link: str) -> list[int]:
        joint, found = geometry.geometryObjects[shapes[link][0]].parentJoint, []
        while joint > 0:
            found.append(joint)
            joint = model.parents[joint]
        return found

    pairs = {tuple(sorted(pair)) for group in HAND.never_meeting for pair in combinations(group, 2)}
    for first, second in sorted(pairs):
        if first not in shapes or second not in shapes:
            continue  # rigid with the palm; the arm is not part of this model
        between = sorted(set(ancestors(first)) ^ set(ancestors(second)))
        if len(between) <= 1:
            continue  # rigid, or parent and child
        columns = [model.joints[joint].idx_q for joint in between]
        count = {2: 17, 3: 9, 4: 6}[len(between)]
        grids = [np.linspace(model.lowerPositionLimit[c], model.upperPositionLimit[c], count) for c in columns]
        smallest = np.inf
        for values in product(*grids):
            q = pin.neutral(model)
            q[columns] = values
            pin.updateGeometryPlacements(model, data, geometry, placed, q)
            for a in shapes[first]:
                for b in shapes[second]:
                    smallest = min(
                        smallest,
                        coal.distance(
                            geometry.geometryObjects[a].geometry,
                            placed.oMg[a],
                            geometry.geometryObjects[b].geometry,
                            placed.oMg[b],
                            coal.DistanceRequest(),
                            coal.DistanceResult(),
                        ),
                    )
        assert smallest > 0.003, (first, second, smallest)
