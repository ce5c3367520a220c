"""ROS 2 messages, made without ROS; the definitions of a planning scene (moveit_msgs) are here, as rosbags has none."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from pipeline.records.poses import position_quaternion

# Fields as MoveIt 2 defines them; constants and comments are left out.
DEFINITIONS = {
    "object_recognition_msgs/msg/ObjectType": "string key\nstring db",
    "octomap_msgs/msg/Octomap": "std_msgs/Header header\nbool binary\nstring id\nfloat64 resolution\nint8[] data",
    "octomap_msgs/msg/OctomapWithPose": "std_msgs/Header header\ngeometry_msgs/Pose origin\n"
    "octomap_msgs/Octomap octomap",
    "moveit_msgs/msg/CollisionObject": "std_msgs/Header header\ngeometry_msgs/Pose pose\nstring id\n"
    "object_recognition_msgs/ObjectType type\nshape_msgs/SolidPrimitive[] primitives\n"
    "geometry_msgs/Pose[] primitive_poses\nshape_msgs/Mesh[] meshes\ngeometry_msgs/Pose[] mesh_poses\n"
    "shape_msgs/Plane[] planes\ngeometry_msgs/Pose[] plane_poses\nstring[] subframe_names\n"
    "geometry_msgs/Pose[] subframe_poses\nbyte operation",
    "moveit_msgs/msg/AttachedCollisionObject": "string link_name\nmoveit_msgs/CollisionObject object\n"
    "string[] touch_links\ntrajectory_msgs/JointTrajectory detach_posture\nfloat64 weight",
    "moveit_msgs/msg/RobotState": "sensor_msgs/JointState joint_state\n"
    "sensor_msgs/MultiDOFJointState multi_dof_joint_state\n"
    "moveit_msgs/AttachedCollisionObject[] attached_collision_objects\nbool is_diff",
    "moveit_msgs/msg/AllowedCollisionEntry": "bool[] enabled",
    "moveit_msgs/msg/AllowedCollisionMatrix": "string[] entry_names\nmoveit_msgs/AllowedCollisionEntry[] entry_values\n"
    "string[] default_entry_names\nbool[] default_entry_values",
    "moveit_msgs/msg/LinkPadding": "string link_name\nfloat64 padding",
    "moveit_msgs/msg/LinkScale": "string link_name\nfloat64 scale",
    "moveit_msgs/msg/ObjectColor": "string id\nstd_msgs/ColorRGBA color",
    "moveit_msgs/msg/PlanningSceneWorld": "moveit_msgs/CollisionObject[] collision_objects\n"
    "octomap_msgs/OctomapWithPose octomap",
    "moveit_msgs/msg/PlanningScene": "string name\nmoveit_msgs/RobotState robot_state\nstring robot_model_name\n"
    "geometry_msgs/TransformStamped[] fixed_frame_transforms\n"
    "moveit_msgs/AllowedCollisionMatrix allowed_collision_matrix\nmoveit_msgs/LinkPadding[] link_padding\n"
    "moveit_msgs/LinkScale[] link_scale\nmoveit_msgs/ObjectColor[] object_colors\n"
    "moveit_msgs/PlanningSceneWorld world\nbool is_diff",
}


def message_types() -> Any:
    """Return the store of all message types that a bag of a plan has."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    own: dict[str, Any] = {}
    for name, text in DEFINITIONS.items():
        own |= get_types_from_msg(text, name)
    store.register(own)
    return store


class Messages:
    """Makes messages by name; fields that are not given are empty, zero or false."""

    def __init__(self) -> None:
        self.store = message_types()

    def make(self, name: str, /, **fields: Any) -> Any:
        """Return a message of a type such as `std_msgs/msg/Header`."""
        definitions = dict(self.store.fielddefs[name][1])
        unknown = set(fields) - set(definitions)
        assert not unknown, f"{name} has no field {unknown}"
        values = {field: self._value(kind, fields.get(field)) for field, kind in definitions.items()}
        return self.store.types[name](**values)

    def _value(self, kind: Any, given: Any) -> Any:
        node, detail = kind
        if node == Nodetype.NAME:
            return self.make(detail) if given is None else given
        if node == Nodetype.BASE:
            return {"string": "", "bool": False}.get(detail[0], 0) if given is None else given
        (inner, inner_detail), length = detail
        values = [] if given is None else given
        if inner == Nodetype.BASE and inner_detail[0] != "string":
            dtype = "uint8" if inner_detail[0] in ("byte", "octet") else inner_detail[0]
            empty = np.zeros(length if node == Nodetype.ARRAY else 0, dtype)
            return empty if given is None else np.asarray(values, dtype)
        return list(values)

    def time(self, seconds: float, kind: str = "Time") -> Any:
        """Return a moment, or with `Duration` a length of time, to the nanosecond."""
        total = round(seconds * 1e9)
        return self.make(f"builtin_interfaces/msg/{kind}", sec=total // 10**9, nanosec=total % 10**9)

    def header(self, seconds: float, frame: str) -> Any:
        """Return a header."""
        return self.make("std_msgs/msg/Header", stamp=self.time(seconds), frame_id=frame)

    def pose(self, T: NDArray[np.float64]) -> Any:
        """Return a pose from ``T`` (4, 4)."""
        position, rotation = self._parts(T)
        return self.make(
            "geometry_msgs/msg/Pose", position=self.make("geometry_msgs/msg/Point", **position), orientation=rotation
        )

    def transform(self, seconds: float, parent: str, child: str, T: NDArray[np.float64]) -> Any:
        """Return ``T_parent_child`` (4, 4) with its frames."""
        position, rotation = self._parts(T)
        moved = self.make("geometry_msgs/msg/Vector3", **position)
        return self.make(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(seconds, parent),
            child_frame_id=child,
            transform=self.make("geometry_msgs/msg/Transform", translation=moved, rotation=rotation),
        )

    def _parts(self, T: NDArray[np.float64]) -> tuple[dict[str, float], Any]:
        position, (w, x, y, z) = position_quaternion(T)
        places = dict(zip("xyz", position.tolist(), strict=True))
        return places, self.make("geometry_msgs/msg/Quaternion", x=float(x), y=float(y), z=float(z), w=float(w))

    def mesh(self, vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> Any:
        """Return triangles for a planning scene."""
        points = [self.make("geometry_msgs/msg/Point", x=x, y=y, z=z) for x, y, z in vertices.tolist()]
        triangles = [self.make("shape_msgs/msg/MeshTriangle", vertex_indices=face) for face in faces]
        return self.make("shape_msgs/msg/Mesh", triangles=triangles, vertices=points)
