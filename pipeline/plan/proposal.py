"""A whole sequence proposed before anything moves: objects, grasp, phases, and its form for a robot's controller."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluate.grasps import SequenceGrasp
from pipeline.evaluate.scene import START_ARM, object_obstacle
from pipeline.evaluate.sequence import Phase, Posture, Surroundings, pick_phases, plan_all
from pipeline.hand.model import Hand
from pipeline.hand.robot import ARM_JOINT_NAMES, robot_joint_names
from pipeline.motion.collisions import overlap
from pipeline.plan.limits import Check, Waypoints
from pipeline.records.errors import UserError
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.physics import PhysicsParameters

HOME = "home"  # name of the first way-point


@dataclass(frozen=True)
class StandingObject:
    """An object and where it stands."""

    prepared: PreparedObject
    T_world_object: NDArray[np.float64]  # (4, 4), world frame: the robot's base


@dataclass(frozen=True)
class Table:
    """What is before the robot: the objects to pick, in that order, and others to keep away from."""

    objects: tuple[StandingObject, ...]
    others: tuple[StandingObject, ...] = ()


def propose(
    table: Table, grasp: SequenceGrasp, hand: Hand, settings: EvaluateParameters, rng: np.random.Generator
) -> list[Phase]:
    """Return all phases from the start posture to the hold.

    Raises:
        UserError: objects stand in each other, or one of the picks has no motion.
    """
    standing = (*table.objects, *table.others)
    obstacles = [
        object_obstacle(item.prepared, f"object{index}").at(item.T_world_object) for index, item in enumerate(standing)
    ]
    for (index, one), (number, other) in combinations(enumerate(obstacles), 2):
        if overlap(one, other):
            names = " and ".join(standing[which].prepared.name for which in (index, number))
            raise UserError(f"{names} would stand in each other; place them apart.")
    count = len(table.objects)
    around = Surroundings(tuple(obstacles[:count]), tuple(obstacles[count:]))
    start = Posture(START_ARM, hand.start)
    picks = plan_all(grasp, hand, around, start, settings, rng)
    if len(picks) < count:
        raise UserError(
            f"no motion was found that picks {table.objects[len(picks)].prepared.name} with grasp {grasp.merged_id}; "
            "choose another grasp with --merged-id, or place the objects elsewhere."
        )
    phases: list[Phase] = []
    for number, pick in enumerate(picks):
        phases += pick_phases(number, phases[-1].last if phases else start, grasp, pick, settings)
    return phases


def waypoints_of(phases: Sequence[Phase], hand: Hand, frequency: int) -> Waypoints:
    """Return the phases as one series that begins with the start posture at time 0."""
    start = np.concatenate([START_ARM, hand.start])[None]
    q = np.concatenate([start, *(np.concatenate([phase.arm, phase.hand], axis=1) for phase in phases)])
    names = [HOME, *(phase.name for phase in phases for _ in phase.arm)]
    velocity = np.concatenate([np.zeros((1, 7)), *(phase.arm_velocity for phase in phases)])
    return Waypoints(np.arange(len(q)) / frequency, tuple(names), q, velocity)


def squeeze_torque(grasp: SequenceGrasp, physics: PhysicsParameters) -> NDArray[np.float64]:
    """Return (J,) N m: what the fingers' drives ask for when objects stop them at the grasp, at most their limit."""
    demand = physics.hand_stiffness * (grasp.squeeze_q - grasp.q)
    return np.clip(demand, -physics.hand_torque_limit, physics.hand_torque_limit)


def plan_record(
    hand: Hand, table: Table, grasp: SequenceGrasp, source: str, waypoints: Waypoints, checks: Sequence[Check]
) -> dict[str, Any]:
    """Return the content of ``plan.json``; docs/plan.md explains it."""
    names = list(dict.fromkeys(waypoints.phases))
    phases = []
    for name in names[1:]:
        own = [index for index, phase in enumerate(waypoints.phases) if phase == name]
        times = waypoints.times[[own[0] - 1, own[-1]]].tolist()
        phases.append({"name": name, "begin": times[0], "end": times[1], "first": own[0], "last": own[-1]})
    return {
        "units": {"time": "s", "position": "rad", "velocity": "rad/s", "length": "m"},
        "world_frame": "panda_link0: x forward, z up",
        "joint_names": list(robot_joint_names(hand)),
        "grasp": {"table": source, "merged_id": grasp.merged_id},
        "objects": [_placed(item) for item in table.objects],
        "others": [_placed(item) for item in table.others],
        "phases": phases,
        "waypoints": [
            {"time": time, "phase": phase, "position": q, "arm_velocity": velocity}
            for time, phase, q, velocity in waypoints.rows()
        ],
        "checks": [asdict(check) | {"passed": check.passed} for check in checks],
        "within_limits": all(check.passed for check in checks),
    }


def _placed(item: StandingObject) -> dict[str, Any]:
    return {"name": item.prepared.name, "T_world_object": item.T_world_object.tolist()}


def plan_csv(hand: Hand, waypoints: Waypoints) -> str:
    """Return the way-points as text: time, phase, positions of all joints, velocities of the arm."""
    target = io.StringIO()
    writer = csv.writer(target, lineterminator="\n")
    writer.writerow(["time", "phase", *robot_joint_names(hand), *(f"{name}_velocity" for name in ARM_JOINT_NAMES)])
    for time, phase, q, velocity in waypoints.rows():
        writer.writerow([time, phase, *q, *velocity])
    return target.getvalue()
