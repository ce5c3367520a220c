"""Collision tests of the arm, the hand and a held object against the scene and against the arm itself."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from pipeline.motion.arm_model import ArmModel

# The hand as a whole is tested against these; links nearer to the wrist cannot reach it.
_SELF_LINKS = tuple(f"panda_link{index}" for index in range(5))
# The base stands on the table by design, and the shoulder cannot leave its place.
_GROUNDED_LINKS = ("panda_link0", "panda_link1")


def box_shape(size: ArrayLike) -> Any:
    """Return a box of full ``size`` (3,), m, centred at its origin."""
    return coal.Box(*np.asarray(size, np.float64))


def convex_shape(points: ArrayLike) -> Any:
    """Return the convex hull of ``points`` (n, 3), m."""
    vector = coal.StdVec_Vec3s()
    for point in np.asarray(points, np.float64):
        vector.append(point)
    return coal.Convex.convexHull(vector, True, "Qt")


@dataclass(frozen=True)
class Obstacle:
    """Something the robot must not hit, or holds: convex shapes with one pose."""

    name: str
    shapes: tuple[Any, ...]  # coal geometries in the obstacle's frame
    pose: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))  # T_world_obstacle, or T_hand_object if held

    def at(self, pose: ArrayLike) -> Obstacle:
        """Return the same thing with another pose."""
        return Obstacle(self.name, self.shapes, np.asarray(pose, np.float64))


def overlap(one: Obstacle, other: Obstacle) -> bool:
    """Whether two things at their poses are in each other."""

    def placed(thing: Obstacle) -> Any:
        return coal.Transform3s(thing.pose[:3, :3], thing.pose[:3, 3])

    request = coal.CollisionRequest()
    return any(
        coal.collide(first, placed(one), second, placed(other), request, coal.CollisionResult()) > 0
        for first in one.shapes
        for second in other.shapes
    )


@lru_cache(maxsize=4)  # worlds of one pick share their arm models
def _hand_hull(arm: ArmModel) -> Any:
    """Convex hull of flange, mount and hand, in the frame of the last joint."""
    points = []
    for item in arm.geometry.geometryObjects:
        if item.parentJoint != 7:
            continue
        placement = item.placement.homogeneous
        shape = item.geometry
        if hasattr(shape, "halfSide"):
            corners = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), -1).reshape(-1, 3) * np.asarray(shape.halfSide)
        elif hasattr(shape, "radius"):  # a ball, or a cylinder along z: the box about it
            half = np.array([shape.radius, shape.radius, getattr(shape, "halfLength", shape.radius)])
            corners = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), -1).reshape(-1, 3) * half
        else:
            corners = np.asarray(shape.points())
        points.append(corners @ placement[:3, :3].T + placement[:3, 3])
    return convex_shape(np.concatenate(points))


class CollisionWorld:
    """A scene for one arm model.

    Args:
        arm: the arm with its hand posture.
        obstacles: what stands around.
        held: what the hand holds, with ``pose`` = ``T_hand_object``; it is not tested against the hand.
        allowed: names of obstacles that the hand (not the arm) may touch, such as the object about to be grasped.
        margin: least distance to obstacles, m; may be negative to forgive touching.

    Attributes:
        arm, obstacles, held, margin: as given.
    """

    def __init__(
        self,
        arm: ArmModel,
        obstacles: Sequence[Obstacle],
        held: Sequence[Obstacle] = (),
        allowed: Iterable[str] = (),
        margin: float = 0.0,
    ) -> None:
        self.arm, self.obstacles, self.held, self.margin = arm, tuple(obstacles), tuple(held), margin
        self._geometry = arm.geometry.copy()
        links = [(index, item.name) for index, item in enumerate(self._geometry.geometryObjects)]
        wrist = [index for index, _ in links if self._geometry.geometryObjects[index].parentJoint == 7]
        bodies = [index for index, name in links if index not in wrist and not _is_link(name, _GROUNDED_LINKS)]
        scene = self._add(obstacles, 0, np.eye(4))
        carried = self._add(held, 7, arm.T_link7_hand)
        whole = self._geometry.addGeometryObject(
            pin.GeometryObject("hand_hull", 7, pin.SE3.Identity(), _hand_hull(arm))
        )
        allowed = set(allowed)
        pairs = [(body, item, margin) for body in bodies for _, items in scene for item in items]
        pairs += [
            (body, item, margin) for body in wrist for name, items in scene if name not in allowed for item in items
        ]
        own = [item for _, items in carried for item in items]
        pairs += [(body, item, margin) for body in own for _, items in scene for item in items]
        self_links = [index for index, name in links if _is_link(name, _SELF_LINKS)]
        pairs += [(link, item, 0.0) for link in self_links for item in [whole, *own]]
        pairs += [
            (first, second, 0.0)
            for first, _ in links
            for second, _ in links
            if second not in wrist and self._parent(second) - self._parent(first) >= 3
        ]
        for first, second, _ in pairs:
            self._geometry.addCollisionPair(pin.CollisionPair(first, second))
        self._data = arm.model.createData()
        self._geometry_data = pin.GeometryData(self._geometry)
        for index, (_, _, distance) in enumerate(pairs):
            self._geometry_data.collisionRequests[index].security_margin = distance

    def _parent(self, index: int) -> int:
        return int(self._geometry.geometryObjects[index].parentJoint)

    def _add(
        self, things: Sequence[Obstacle], joint: int, T_joint_frame: NDArray[np.float64]
    ) -> list[tuple[str, list[int]]]:
        added = []
        for thing in things:
            T = T_joint_frame @ thing.pose
            placement = pin.SE3(T[:3, :3], T[:3, 3])
            indices = [
                self._geometry.addGeometryObject(pin.GeometryObject(f"{thing.name}/{index}", joint, placement, shape))
                for index, shape in enumerate(thing.shapes)
            ]
            added.append((thing.name, indices))
        return added

    def is_free(self, q: NDArray[np.float64]) -> bool:
        """Whether arm joints ``q`` (7,) collide with nothing."""
        return not pin.computeCollisions(self.arm.model, self._data, self._geometry, self._geometry_data, q, True)

    def all_free(self, path: NDArray[np.float64]) -> bool:
        """Whether every row of ``path`` (n, 7) collides with nothing."""
        return all(self.is_free(q) for q in path)


def _is_link(name: str, links: Sequence[str]) -> bool:
    """Whether a geometry ``panda_link3_0`` belongs to one of ``links``."""
    return name.rsplit("_", 1)[0] in links
