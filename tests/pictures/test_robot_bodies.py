"""The drawn hand and robot stand where kinematics say."""

import numpy as np
import pytest

from pipeline.hand.kinematics import link_poses
from pipeline.hand.model import load_hand
from pipeline.pictures.robot import LARGEST_MESH, hand_bodies, robot_bodies
from pipeline.records.poses import inverse_pose, transform_points

HAND = load_hand("allegro")
POSTURE = np.array([0.1, 0.7, 0.2, 0.4, 0, 0.5, 0.3, 0.4, -0.1, 0.9, 0.1, 0.6, 1.0, 0.3, 0.2, 0.5])


def test_drawn_fingertips_fill_the_collision_balls() -> None:
    """The tip meshes were cut from balls of 12 mm about the tip frames; their round end is along +z."""
    T_world_hand = np.eye(4)
    T_world_hand[:3, 3] = [0.1, 0.2, 0.3]
    bodies = hand_bodies(T_world_hand, POSTURE, HAND)
    poses = T_world_hand @ link_poses(HAND, POSTURE[None])[0]
    for link in HAND.sphere_link:
        local = [transform_points(inverse_pose(poses[link]), body.world_vertices()) for body in bodies]
        sizes = [np.array([p[:, 0].min(), p[:, 0].max(), p[:, 1].min(), p[:, 1].max(), p[:, 2].max()]) for p in local]
        errors = [np.abs(size - [-0.012, 0.012, -0.012, 0.012, 0.012]).max() for size in sizes]
        assert min(errors) < 0.0005


def test_arm_carries_the_hand_at_the_published_mount() -> None:
    import pinocchio

    from pipeline.hand.robot import compose_robot

    arm = np.array([0.1, -0.3, 0.2, -2.0, 0.1, 1.8, 0.7])
    model = pinocchio.buildModelFromXML(compose_robot(True, False, HAND))
    data = model.createData()
    q = np.zeros(model.nq)
    for index in range(7):
        q[model.joints[model.getJointId(f"panda_joint{index + 1}")].idx_q] = arm[index]
    pinocchio.framesForwardKinematics(model, data, q)
    T_world_hand = data.oMf[model.getFrameId("panda_link7")].homogeneous @ HAND.mount.T_link7_hand
    robot = robot_bodies(np.concatenate([arm, POSTURE]), HAND)
    hand = hand_bodies(T_world_hand, POSTURE, HAND)
    for drawn, expected in zip(robot[-len(hand) :], hand, strict=True):
        np.testing.assert_allclose(drawn.T_world, expected.T_world, atol=1e-5)


def test_robot_is_of_the_right_height_and_light_enough_to_draw() -> None:
    """A Panda with all joints at 0 stands straight: shoulder 0.333 m, upper arm 0.316 m, forearm 0.384 m above."""
    bodies = robot_bodies(np.zeros(23), HAND)
    top = max(body.world_vertices()[:, 2].max() for body in bodies)
    assert top == pytest.approx(0.333 + 0.316 + 0.384 + 0.06, abs=0.03)
    assert min(body.world_vertices()[:, 2].min() for body in bodies) == pytest.approx(0.0, abs=0.002)
    assert all(len(body.faces) <= LARGEST_MESH for body in bodies)
