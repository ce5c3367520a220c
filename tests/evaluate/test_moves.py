from __future__ import annotations

import numpy as np
import pytest

from pipeline.evaluate.moves import LINE_SHARE, PickTask, plan_pick
from pipeline.evaluate.scene import START_ARM, object_obstacle, placed, support_obstacles
from pipeline.motion.arm_model import ArmModel
from pipeline.motion.collisions import CollisionWorld, Obstacle, box_shape
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.poses import inverse_pose
from tests.evaluate.conftest import HAND
from tests.pairs import PAIR

SETTINGS = EvaluateParameters()


@pytest.fixture
def task(objects, grasp) -> PickTask:
    """The first pick of the recorded grasp."""
    first, second = placed(PAIR, objects, SETTINGS, np.zeros((2, 3)))
    own = grasp.picks[0]
    return PickTask(
        hand=HAND,
        arm_q=START_ARM,
        hand_q=own.open_q,
        closed_q=grasp.q,
        target=object_obstacle(objects[0], "object0").at(first),
        T_hand_target=own.T_hand_object,
        held=(),
        others=(object_obstacle(objects[1], "object1").at(second),),
        direction=first[:3, :3] @ own.approach_direction,
        lengths=(0.05,),
        lift_height=0.1,
    )


def test_moves_follow_each_other_and_end_where_they_should(task: PickTask) -> None:
    pick = plan_pick(task, SETTINGS, np.random.default_rng(0))
    assert pick is not None
    np.testing.assert_array_equal(pick.approach.positions[0], START_ARM)
    np.testing.assert_array_equal(pick.approach.positions[-1], pick.entry.positions[0])
    np.testing.assert_array_equal(pick.entry.positions[-1], pick.lift.positions[0])
    arm = ArmModel(task.hand_q, HAND)
    grasp_pose = task.target.pose @ inverse_pose(task.T_hand_target)
    np.testing.assert_allclose(arm.hand_pose(pick.entry.positions[-1]), grasp_pose, atol=2e-3)
    begin, end = (arm.hand_pose(pick.entry.positions[index])[:3, 3] for index in (0, -1))
    np.testing.assert_allclose(begin - end, 0.05 * task.direction, atol=1e-3)
    lifted = arm.hand_pose(pick.lift.positions[-1])[:3, 3]
    np.testing.assert_allclose(lifted - end, [0, 0, 0.1], atol=1e-3)
    assert np.abs(pick.entry.velocities).max() <= LINE_SHARE[0] * arm.velocity.max() * 1.01


def test_moves_hit_nothing(task: PickTask) -> None:
    pick = plan_pick(task, SETTINGS, np.random.default_rng(0))
    assert pick is not None
    arm, supports = ArmModel(task.hand_q, HAND), support_obstacles(SETTINGS, 0.0)
    assert CollisionWorld(arm, [*supports, *task.others, task.target]).all_free(pick.approach.positions)
    lower = support_obstacles(SETTINGS, 0.004)
    assert CollisionWorld(arm, [*lower, *task.others]).all_free(pick.entry.positions)


def test_equal_generators_give_equal_moves(task: PickTask) -> None:
    picks = [plan_pick(task, SETTINGS, np.random.default_rng(3)) for _ in range(2)]
    assert picks[0] is not None and picks[1] is not None
    for move in ("approach", "entry", "lift"):
        np.testing.assert_array_equal(getattr(picks[0], move).positions, getattr(picks[1], move).positions)


def test_blocked_lines_are_refused(task: PickTask) -> None:
    """A lid close over the object leaves no way up; a box around the hand's place leaves no grasp."""
    from dataclasses import replace

    hand = (task.target.pose @ inverse_pose(task.T_hand_target))[:3, 3]
    block = np.eye(4)
    block[:3, 3] = hand
    inside = Obstacle("block", (box_shape([0.03] * 3),), block)
    assert plan_pick(replace(task, others=(inside,)), SETTINGS, np.random.default_rng(0)) is None
    lid = np.eye(4)
    lid[:3, 3] = (hand[0], hand[1], task.target.pose[2, 3] + 0.45)
    ceiling = Obstacle("ceiling", (box_shape([0.8, 0.8, 0.02]),), lid)
    assert plan_pick(replace(task, others=(ceiling,), lift_height=0.4), SETTINGS, np.random.default_rng(0)) is None


def test_shorter_entry_is_used_when_the_long_one_is_blocked(task: PickTask) -> None:
    from dataclasses import replace

    long = plan_pick(replace(task, lengths=(2.0, 0.05)), SETTINGS, np.random.default_rng(0))
    assert long is not None
    arm = ArmModel(task.hand_q, HAND)
    length = np.linalg.norm(
        arm.hand_pose(long.entry.positions[0])[:3, 3] - arm.hand_pose(long.entry.positions[-1])[:3, 3]
    )
    assert length == pytest.approx(0.05, abs=1e-3)
