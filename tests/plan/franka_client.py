"""Stream the arm of a plan to a simulated Franka Research 3 over the real robot's protocol, and say what it did.

Run by tests/plan/test_franka.py in an environment of its own, with franky-sim (the robot) and franky-control
(libfranka): `python franka_client.py PLAN.json RESULT.json`. The result holds, for every millisecond that the robot was
controlled, the time (s) and the commanded and measured joint positions (rad).
"""

import json
import sys

import franky
import numpy as np
from franky_sim import SimulationServer
from franky_sim.mujoco_simulator import MujocoSimulator

EVERY = 5  # way-points of the plan for one of the robot's
STILL = 1e-6  # rad
CYCLE = 0.001  # s, which the robot spends at every one of its way-points
NEAR = 0.01  # rad; the simulated drives creep to their target


def milliseconds(seconds: float) -> franky.Duration:
    return franky.Duration(round(1000 * seconds))


def waypoints(t: np.ndarray, q: np.ndarray, v: np.ndarray) -> list[franky.JointWaypoint]:
    """The plan as targets with velocities and times; where the arm rests, the last one is held."""
    rows = sorted({*range(0, len(t), EVERY), len(t) - 1})
    found: list[list] = []  # row, time to get there, time to stay
    for before, row in zip(rows, rows[1:], strict=False):
        if np.abs(q[before : row + 1] - q[row]).max() < STILL and found:
            found[-1][2] += t[row] - t[before]
        elif np.abs(q[before : row + 1] - q[row]).max() < STILL:
            found.append([row, 0.0, t[row] - t[before]])
        else:
            found.append([row, t[row] - t[before], 0.0])
    last = len(found) - 1
    return [
        franky.JointWaypoint(
            franky.JointState(q[row].tolist(), ([0.0] * 7 if index == last or stay else v[row].tolist())),
            minimum_time=milliseconds(way - CYCLE) if way else None,
            hold_target_duration=milliseconds(stay),
        )
        for index, (row, way, stay) in enumerate(found)
    ]


def main(plan_file: str, result_file: str) -> None:
    with open(plan_file) as file:
        points = json.load(file)["waypoints"]
    t = np.array([point["time"] for point in points])
    q = np.array([point["position"][:7] for point in points])
    v = np.array([point["arm_velocity"] for point in points])
    seen: list[tuple[float, list[float], list[float]]] = []
    with MujocoSimulator(enable_visualization=False) as simulator:
        model = simulator.add_robot()
        with SimulationServer(simulator) as server:
            server.run_async(realtime=False)
            robot = franky.Robot(model.hostname, realtime_config=franky.RealtimeConfig.Ignore)
            robot.relative_dynamics_factor = 1.0
            for _ in range(8):
                robot.move(franky.JointMotion(q[0].tolist()))
                if np.abs(np.array(robot.state.q) - q[0]).max() < NEAR:
                    break
            motion = franky.JointWaypointMotion(waypoints(t, q, v))
            motion.register_callback(
                lambda state, step, since, absolute, control: seen.append(
                    (since.to_sec(), list(state.q_d), list(state.q))
                )
            )
            robot.move(motion)
    time, commanded, measured = (list(column) for column in zip(*seen, strict=True))
    with open(result_file, "w") as file:
        json.dump({"time": time, "commanded": commanded, "measured": measured}, file)


if __name__ == "__main__":
    main(*sys.argv[1:])
