"""The Panda with a hand in a fixed posture: hand pose, Jacobian, and collision shapes.

While the arm moves the fingers do not, so a model of seven joints is enough: every shape of the hand rides on the last
arm joint. The model is built anew for every hand posture, which takes milliseconds.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from pipeline.hand.model import Hand
from pipeline.hand.robot import ARM_JOINT_NAMES, robot_file

# Acceleration limits of the Panda, rad/s2 (Franka's interface specifications); the URDF has none.
ARM_ACCELERATION = np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0])


@lru_cache(maxsize=2)
def _full_robot(hand: Hand) -> tuple[Any, Any]:
    """Pinocchio model and geometry of all joints of arm and hand; meshes become their convex hulls, as in physics."""
    description = str(robot_file(True, hand))
    model = pin.buildModelFromUrdf(description)
    geometry = pin.buildGeomFromUrdf(model, description, pin.GeometryType.COLLISION)
    for item in geometry.geometryObjects:
        if hasattr(item.geometry, "buildConvexHull"):
            item.geometry.buildConvexHull(True, "Qt")
            item.geometry = item.geometry.convex
    return model, geometry


class ArmModel:
    """Seven arm joints with the hand locked at one posture.

    Attributes:
        hand: the hand.
        model: Pinocchio model, ``nq`` 7.
        geometry: Pinocchio geometry of the robot, without collision pairs.
        lower, upper: (7,) joint limits, rad.
        velocity: (7,) velocity limits, rad/s.
    """

    def __init__(self, hand_q: ArrayLike, hand: Hand) -> None:
        """Build the model; ``hand_q`` (J,) in the order of ``hand.joint_names``, rad."""
        self.hand = hand
        full, geometry = _full_robot(hand)
        q = pin.neutral(full)
        for name, angle in zip(hand.physical.names, hand.physical.positions(hand_q), strict=True):
            q[full.joints[full.getJointId(name)].idx_q] = angle
        locked = [full.getJointId(name) for name in hand.physical.names]
        self.model, self.geometry = pin.buildReducedModel(full, geometry, locked, q)
        assert list(self.model.names)[1:] == list(ARM_JOINT_NAMES)
        self.lower: NDArray[np.float64] = self.model.lowerPositionLimit.copy()
        self.upper: NDArray[np.float64] = self.model.upperPositionLimit.copy()
        self.velocity: NDArray[np.float64] = self.model.velocityLimit.copy()
        self._frame = self.model.getFrameId(hand.root)
        self._data = self.model.createData()

    def hand_pose(self, q: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return ``T_base_hand`` (4, 4) at arm joints ``q`` (7,); the robot's base is the world's origin."""
        pin.framesForwardKinematics(self.model, self._data, q)
        pose: NDArray[np.float64] = self._data.oMf[self._frame].homogeneous.copy()
        return pose

    def pose_errors(
        self, T_base_hand: NDArray[np.float64]
    ) -> Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Return a function from arm joints (7,) to the twist (6,) from the hand's pose to a goal, and the Jacobian.

        The Jacobian is (6, 7); both are in the hand frame, linear part first, m and rad.
        """
        model, data, frame = self.model, self._data, self._frame
        goal = pin.SE3(T_base_hand[:3, :3], T_base_hand[:3, 3])

        def error(q: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
            pin.computeJointJacobians(model, data, q)
            placement = pin.updateFramePlacement(model, data, frame)
            return pin.log6(placement.actInv(goal)).vector, pin.getFrameJacobian(model, data, frame, pin.LOCAL)

        return error

    @property
    def T_link7_hand(self) -> NDArray[np.float64]:
        """Fixed transform (4, 4) from the hand to the last joint's frame."""
        placement: NDArray[np.float64] = self.model.frames[self._frame].placement.homogeneous.copy()
        return placement
