"""Hands whose joints follow others, or slide, in both engines."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.hand.kinematics import link_poses
from pipeline.hand.model import Hand, hand_of_file
from pipeline.physics.engine import steps_in
from pipeline.physics.world import make_world
from tests.hand.toy import write_coupled
from tests.physics.engines import at, in_both, settings

START, GOAL = np.array([0.1, 0.1, 0.2, 0.0]), np.array([0.35, 0.25, 0.3, 0.015])


@pytest.fixture(scope="module")
def coupled(tmp_path_factory: pytest.TempPathFactory) -> Hand:
    return hand_of_file(write_coupled(tmp_path_factory.mktemp("hands") / "coupled"))


@in_both
def test_joints_that_follow_are_placed_and_driven_with_their_driver(engine: str, coupled: Hand) -> None:
    world = make_world(settings(engine))
    robot = world.add_hand(coupled, at(z=0.3), START)
    assert robot.joint_names == coupled.joint_names
    np.testing.assert_allclose(robot.q, START, atol=1e-6)
    for name, pose in zip(coupled.link_names, link_poses(coupled, START[None])[0], strict=True):
        np.testing.assert_allclose(robot.link_pose(name), at(z=0.3) @ pose, atol=1e-6, err_msg=name)
    robot.set_targets(GOAL)
    world.step(steps_in(2.0, world.frequency))
    np.testing.assert_allclose(robot.q, GOAL, atol=2e-3)
    for name, pose in zip(coupled.link_names, link_poses(coupled, GOAL[None])[0], strict=True):
        np.testing.assert_allclose(robot.link_pose(name), at(z=0.3) @ pose, atol=2e-3, err_msg=name)


@in_both
def test_a_joint_that_slides_pushes_with_the_force_of_its_drive(engine: str, coupled: Hand) -> None:
    """The far finger's first link pushes along its slide against a box that does not move: 40 N, the URDF's effort."""
    world = make_world(settings(engine))
    robot = world.add_hand(coupled, np.eye(4), START)
    near = link_poses(coupled, START[None])[0, coupled.link("far_near")]
    axis = near[:3, :3] @ coupled.axis[coupled.link("far_near")]
    wall = near.copy()
    wall[:3, 3] += near[:3, :3] @ [0.0, 0.0, 0.03] + axis * (0.007 + 0.01 + 0.0005)
    wall[:3, :3] = near[:3, :3]
    body = world.add_box([0.01, 0.01, 0.01], wall, "wall")
    robot.set_targets([0.1, 0.1, 0.2, coupled.upper[3]])
    world.step(steps_in(1.0, world.frequency))
    impulse = sum(body.link_impulses().values(), np.zeros(3))
    assert coupled.physical.limit[3] == 40.0
    # the finger's second joint is driven on and may lean on the box as well
    assert impulse @ axis * world.frequency == pytest.approx(40.0, rel=0.05)
