"""The composed robot description, as other libraries read it."""

import numpy as np
import pytest

from pipeline.hand.model import load_hand
from pipeline.hand.robot import ARM_JOINT_NAMES, compose_robot, robot_file, robot_joint_names

HAND = load_hand("allegro")
PANDA_LOWER = [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]  # the maker's data sheet, rad
PANDA_UPPER = [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]


def _model():
    pinocchio = pytest.importorskip("pinocchio")
    return pinocchio, pinocchio.buildModelFromUrdf(str(robot_file(True, HAND)))


def test_robot_has_the_arm_and_hand_joints() -> None:
    _, model = _model()
    assert set(model.names) - {"universe"} == set(robot_joint_names(HAND))
    assert model.nq == 23


def test_hand_sits_on_the_flange_as_published() -> None:
    pinocchio, model = _model()
    data = model.createData()
    configuration = np.random.default_rng(0).uniform(model.lowerPositionLimit, model.upperPositionLimit)
    pinocchio.framesForwardKinematics(model, data, configuration)
    flange, hand = (data.oMf[model.getFrameId(name)].homogeneous for name in ("panda_link7", "base_link"))
    np.testing.assert_allclose(np.linalg.inv(flange) @ hand, HAND.mount.T_link7_hand, atol=1e-9)


def test_limits_are_the_makers() -> None:
    _, model = _model()
    for names, lower, upper in (
        (ARM_JOINT_NAMES, PANDA_LOWER, PANDA_UPPER),
        (HAND.joint_names, HAND.lower, HAND.upper),
    ):
        index = [model.joints[model.getJointId(name)].idx_q for name in names]
        np.testing.assert_allclose(model.lowerPositionLimit[index], lower, atol=1e-3)
        np.testing.assert_allclose(model.upperPositionLimit[index], upper, atol=1e-3)


def test_visuals_are_dropped_when_not_wanted() -> None:
    assert "<visual" not in compose_robot(True, False, HAND)
    assert "<visual" in compose_robot(True, True, HAND)
    assert "panda_link0" not in compose_robot(False, False, HAND)
