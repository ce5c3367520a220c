"""A plan for ROS 2, without ROS: `python -m pipeline.plan.bag plan/plan.json` writes a bag and a Foxglove layout.

Beside the plan it writes bag/, a ROS 2 bag whose file bag.mcap Foxglove opens, and foxglove.json, a layout for it.
Topics: /arm/joint_trajectory and /hand/joint_trajectory (trajectory_msgs/JointTrajectory), /joint_states,
/tf and /tf_static, /planning_scene (moveit_msgs/PlanningScene) and /phase (std_msgs/String).
Exit code: 0; 2 when there is no plan, or it breaks a limit, and one sentence says so.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.records.errors import UserError
from pipeline.records.hands import ARM_JOINTS
from pipeline.records.parameters import load_parameters
from pipeline.records.reading import read_json
from pipeline.records.writing import check_writable, replace_folder, write_json
from pipeline.stages.running import command

START = 1.0  # s, stamp of the plan's first moment: a stamp of zero means "the latest" to TF
BAG, LAYOUT = "bag", "foxglove.json"
KINDS = {
    "/arm/joint_trajectory": "trajectory_msgs/msg/JointTrajectory",
    "/hand/joint_trajectory": "trajectory_msgs/msg/JointTrajectory",
    "/joint_states": "sensor_msgs/msg/JointState",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/planning_scene": "moveit_msgs/msg/PlanningScene",
    "/phase": "std_msgs/msg/String",
}
Event = tuple[float, str, Any]  # s since the plan began, topic, message


class Plan:
    """A plan as it was written, in arrays.

    Attributes:
        names: (R,) joints, the arm's first.
        times: (n,) s.
        q: (n, R) rad.
        arm_velocity: (n, 7) rad/s.
        phases: name and beginning (s) of each.
        objects, others: name and ``T_world_object`` (4, 4) of each.
    """

    def __init__(self, source: Path) -> None:
        """Read plan.json.

        Raises:
            UserError: it is missing, damaged, or breaks a limit.
        """
        again = "plan again with `python -m pipeline.plan`"
        content = read_json(source, again)
        try:
            self.names = [str(name) for name in content["joint_names"]]
            points = content["waypoints"]
            self.times = np.array([point["time"] for point in points], np.float64)
            self.q = np.array([point["position"] for point in points], np.float64).reshape(len(points), len(self.names))
            velocities = [point["arm_velocity"] for point in points]
            self.arm_velocity = np.array(velocities, np.float64).reshape(len(points), ARM_JOINTS)
            self.phases = [(str(phase["name"]), float(phase["begin"])) for phase in content["phases"]]
            self.objects = [_placed(item) for item in content["objects"]]
            self.others = [_placed(item) for item in content["others"]]
            kept = bool(content["within_limits"])
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise UserError(f"{source} is damaged or no plan ({error}); {again}.") from error
        if len(self.times) < 2 or not (np.isfinite(self.q).all() and (np.diff(self.times) > 0).all()):
            raise UserError(f"{source} has too few way-points, or some that are no numbers or not in order; {again}.")
        if not kept:
            raise UserError(f"{source} breaks a limit of the hardware (see `checks` there); {again}.")


def _placed(item: Any) -> tuple[str, NDArray[np.float64]]:
    return str(item["name"]), np.array(item["T_world_object"], np.float64).reshape(4, 4)


def write_bag(source: Path) -> Path:
    """Write bag and layout beside a plan and return the bag's folder; the same plan gives the same messages.

    Raises:
        UserError: the plan cannot be used, or the folder cannot be written to.
    """
    plan = Plan(source)
    target = source.parent / BAG
    check_writable(target)
    parameters = load_parameters(["hand", "evaluate"])
    from rosbags.rosbag2 import StoragePlugin, Writer

    from pipeline.hand.model import load_hand
    from pipeline.plan.events import events

    with tempfile.TemporaryDirectory(dir=source.parent, prefix=".bag") as folder:
        made, written = Path(folder) / BAG, 0
        messages, found = events(plan, load_hand(parameters["hand"]), parameters["evaluate"].sponge_height, START)
        with Writer(made, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            connections = {
                topic: writer.add_connection(topic, kind, typestore=messages.store) for topic, kind in KINDS.items()
            }
            for time, topic, message in sorted(found, key=lambda event: event[0]):
                content = messages.store.serialize_cdr(message, KINDS[topic])
                writer.write(connections[topic], round((START + time) * 1e9), content)
                written += 1
        replace_folder(made, target)
    write_json(source.parent / LAYOUT, foxglove_layout(plan))
    print(
        f"{target}: {written} messages, {plan.times[-1]:.1f} s; open bag.mcap in Foxglove with {source.parent / LAYOUT}"
    )
    return target


def foxglove_layout(plan: Plan) -> dict[str, Any]:
    """Return a layout: the scene in 3D, positions of the arm, and the phase."""
    plots = [
        {"value": f"/joint_states.position[{index}]", "label": name, "enabled": True, "timestampMethod": "receiveTime"}
        for index, name in enumerate(plan.names[:ARM_JOINTS])
    ]
    scene = {
        "followTf": "panda_link0",
        "fixedFrame": "panda_link0",
        "scene": {"transforms": {"showLabel": False, "axisScale": 0.1}},
        "topics": {"/planning_scene": {"visible": True}, "/tf": {"visible": True}, "/tf_static": {"visible": True}},
    }
    return {
        "configById": {
            "3D!plan": scene,
            "Plot!arm": {"paths": plots, "showXAxisLabels": True, "showYAxisLabels": True, "xAxisVal": "timestamp"},
            "RawMessages!phase": {"topicPath": "/phase.data", "diffEnabled": False},
        },
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "row",
            "first": "3D!plan",
            "second": {
                "direction": "column",
                "first": "Plot!arm",
                "second": "RawMessages!phase",
                "splitPercentage": 75,
            },
            "splitPercentage": 60,
        },
    }


@command("plan.bag")
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline.plan.bag", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("plan", type=Path, help="plan.json of `python -m pipeline.plan`")
    write_bag(parser.parse_args(arguments).plan)
    return 0


if __name__ == "__main__":
    sys.exit(main())
