"""Every message of a plan's bag, with its moment and topic."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.model import Hand
from pipeline.pictures.colours import OBJECT_COLOURS, SPONGE_COLOUR
from pipeline.pictures.decimation import decimated
from pipeline.plan.messages import Messages
from pipeline.plan.tree import RobotTree
from pipeline.records import paths
from pipeline.records.hands import ARM_JOINTS
from pipeline.records.kept import kept_object
from pipeline.records.ordinals import ORDINALS
from pipeline.records.poses import inverse_pose
from pipeline.shapes.workplace import SPONGE_SIZE, SPONGE_X, TABLE_SIZE, TABLE_X

if TYPE_CHECKING:
    from pipeline.plan.bag import Event, Plan

MOST_FACES = 600  # of an object in the planning scene
BOX = 1  # of shape_msgs/SolidPrimitive
ADD, REMOVE = 0, 1  # of moveit_msgs/CollisionObject


def events(plan: Plan, hand: Hand, sponge_height: float, start: float) -> tuple[Messages, list[Event]]:
    """Return the maker of messages, and all events of a plan.

    Args:
        start: s, stamp of the plan's first moment.
    """
    made = _Events(plan, RobotTree(hand), hand.root, start)
    found = [*made.trajectories(), *made.states(), *made.frames(), *made.scenes(sponge_height)]
    text = "std_msgs/msg/String"
    found += [(begin, "/phase", made.messages.make(text, data=name)) for name, begin in plan.phases]
    return made.messages, found


class _Events:
    """Makes the events of one plan."""

    def __init__(self, plan: Plan, tree: RobotTree, palm: str, start: float) -> None:
        self.plan, self.tree, self.palm, self.start = plan, tree, palm, start
        self.messages = Messages()
        self.closed = [self._closed(number) for number in range(len(plan.objects))]

    def _closed(self, number: int) -> tuple[int, NDArray[np.float64]]:
        """Return the way-point from which the hand carries an object, and ``T_hand_object`` (4, 4) then."""
        begin = dict(self.plan.phases)[f"lift {ORDINALS[number]}"]
        row = int(np.searchsorted(self.plan.times, begin))
        T_world_hand = self.tree.poses(self.plan.q[row])[self.palm]
        return row, inverse_pose(T_world_hand) @ self.plan.objects[number][1]

    def trajectories(self) -> Iterator[Event]:
        """Yield the trajectories of arm and hand, once, at the beginning."""
        plan, make = self.plan, self.messages.make
        speeds = np.asarray(np.gradient(plan.q, plan.times, axis=0))
        speeds[:, :ARM_JOINTS] = plan.arm_velocity
        for topic, own in (("/arm", slice(0, ARM_JOINTS)), ("/hand", slice(ARM_JOINTS, None))):
            points = [
                make(
                    "trajectory_msgs/msg/JointTrajectoryPoint",
                    positions=q[own],
                    velocities=speed[own],
                    time_from_start=self.messages.time(time, "Duration"),
                )
                for time, q, speed in zip(plan.times, plan.q, speeds, strict=True)
            ]
            message = make(
                "trajectory_msgs/msg/JointTrajectory",
                header=self.messages.header(self.start, self.tree.root),
                joint_names=plan.names[own],
                points=points,
            )
            yield 0.0, f"{topic}/joint_trajectory", message

    def states(self) -> Iterator[Event]:
        """Yield the planned joints at every way-point."""
        plan = self.plan
        for time, q, velocity in zip(plan.times.tolist(), plan.q, plan.arm_velocity, strict=True):
            speeds = np.concatenate([velocity, np.zeros(len(q) - ARM_JOINTS)])
            header = self.messages.header(self.start + time, "")
            yield (
                time,
                "/joint_states",
                self.messages.make(
                    "sensor_msgs/msg/JointState", header=header, name=plan.names, position=q, velocity=speeds
                ),
            )

    def frames(self) -> Iterator[Event]:
        """Yield the tree of frames: what is fixed once, links that move and objects at every way-point."""
        still = {branch: T for branch, T in self.tree.relative(self.plan.q[0]).items() if not branch.moves}
        fixed = [self.messages.transform(self.start, branch.parent, branch.child, T) for branch, T in still.items()] + [
            self.messages.transform(self.start, self.tree.root, name, T) for name, T in self.plan.others
        ]
        yield 0.0, "/tf_static", self.messages.make("tf2_msgs/msg/TFMessage", transforms=fixed)
        for row, time in enumerate(self.plan.times.tolist()):
            stamp = self.start + time
            moving = [
                self.messages.transform(stamp, branch.parent, branch.child, T)
                for branch, T in self.tree.relative(self.plan.q[row]).items()
                if branch.moves
            ]
            moving += [self._object_frame(number, row, stamp) for number in range(len(self.plan.objects))]
            yield time, "/tf", self.messages.make("tf2_msgs/msg/TFMessage", transforms=moving)

    def _object_frame(self, number: int, row: int, stamp: float) -> Any:
        name, T = self.plan.objects[number]
        carried_from, T_hand_object = self.closed[number]
        if row >= carried_from:
            T = self.tree.poses(self.plan.q[row])[self.palm] @ T_hand_object
        return self.messages.transform(stamp, self.tree.root, name, T)

    def scenes(self, sponge_height: float) -> Iterator[Event]:
        """Yield the planning scene at the beginning, and what changes when an object is lifted."""
        plan, make = self.plan, self.messages.make
        sponge, table = np.eye(4), np.eye(4)
        sponge[:3, 3] = (SPONGE_X, 0.0, sponge_height / 2)
        table[:3, 3] = (TABLE_X, 0.0, -TABLE_SIZE[2] / 2)
        things = [
            self._box("sponge", (SPONGE_SIZE, SPONGE_SIZE, sponge_height), sponge),
            self._box("table", TABLE_SIZE, table),
            *(self._object(name, T, self.tree.root, 0.0) for name, T in (*plan.objects, *plan.others)),
        ]
        colours = dict(zip((name for name, _ in plan.objects), OBJECT_COLOURS, strict=False)) | {
            "sponge": SPONGE_COLOUR
        }
        yield (
            0.0,
            "/planning_scene",
            make(
                "moveit_msgs/msg/PlanningScene",
                name="plan",
                robot_model_name="panda_allegro",
                robot_state=self._state(plan.q[0], []),
                world=make("moveit_msgs/msg/PlanningSceneWorld", collision_objects=things),
                object_colors=[self._colour(name, colour) for name, colour in colours.items()],
            ),
        )
        for number, (name, _) in enumerate(plan.objects):
            row, T_hand_object = self.closed[number]
            time = float(plan.times[row])
            gone = make(
                "moveit_msgs/msg/CollisionObject",
                header=self.messages.header(self.start + time, self.tree.root),
                id=name,
                operation=REMOVE,
            )
            held = make(
                "moveit_msgs/msg/AttachedCollisionObject",
                link_name=self.palm,
                object=self._object(name, T_hand_object, self.palm, time),
            )
            yield (
                time,
                "/planning_scene",
                make(
                    "moveit_msgs/msg/PlanningScene",
                    name="plan",
                    is_diff=True,
                    robot_state=self._state(plan.q[row], [held]),
                    world=make("moveit_msgs/msg/PlanningSceneWorld", collision_objects=[gone]),
                ),
            )

    def _state(self, q: NDArray[np.float64], attached: Sequence[Any]) -> Any:
        joints = self.messages.make("sensor_msgs/msg/JointState", name=self.plan.names, position=q)
        return self.messages.make(
            "moveit_msgs/msg/RobotState",
            joint_state=joints,
            attached_collision_objects=list(attached),
            is_diff=bool(attached),
        )

    def _colour(self, name: str, colour: Sequence[float]) -> Any:
        rgba = dict(zip("rgba", (*colour, 1.0), strict=True))
        return self.messages.make(
            "moveit_msgs/msg/ObjectColor", id=name, color=self.messages.make("std_msgs/msg/ColorRGBA", **rgba)
        )

    def _box(self, name: str, size: Sequence[float], T: NDArray[np.float64]) -> Any:
        shape = self.messages.make("shape_msgs/msg/SolidPrimitive", type=BOX, dimensions=size)
        return self.messages.make(
            "moveit_msgs/msg/CollisionObject",
            header=self.messages.header(self.start, self.tree.root),
            id=name,
            pose=self.messages.pose(T),
            primitives=[shape],
            primitive_poses=[self.messages.pose(np.eye(4))],
        )

    def _object(self, name: str, T: NDArray[np.float64], frame: str, time: float) -> Any:
        """Return an object with its mesh; where the clone has none (one that photos showed), without a shape."""
        known = (paths.prepared_folder(name) / "mesh.ply").is_file()
        meshes = []
        if known:
            prepared = kept_object(name, grid=False)
            meshes = [self.messages.mesh(*decimated((prepared.vertices, prepared.faces), MOST_FACES))]
        return self.messages.make(
            "moveit_msgs/msg/CollisionObject",
            header=self.messages.header(self.start + time, frame),
            id=name,
            pose=self.messages.pose(T),
            meshes=meshes,
            mesh_poses=[self.messages.pose(np.eye(4)) for _ in meshes],
            operation=ADD,
        )
