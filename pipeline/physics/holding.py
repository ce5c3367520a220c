"""The six-gravity holding test: a floating hand holds any number of objects while gravity pulls from all sides.

The world frame is the hand frame (``base_link``, fixed in space). Gravity directions are given in the frame of the
FIRST object at the grasp, and rotated into the hand frame with its pose. Every direction is a world of its own that
begins with hand and objects at rest in the grasp and all finger drives set to the squeeze target at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.physics.bodies import Body, add_object
from pipeline.physics.contacts import pressing_links
from pipeline.physics.robots import Robot, add_robot
from pipeline.physics.world import GRAVITY, World, make_world
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.validate import ValidateParameters

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
LOST_DISTANCE = 0.15  # m from the start; an object that far away is never held again
WATCH_STEPS = 10  # physics steps between looks at sleep and distance


@dataclass(frozen=True)
class HeldObject:
    """An object in the hand."""

    prepared: PreparedObject
    T_hand_object: NDArray[np.float64]  # (4, 4) at the grasp
    assigned_links: tuple[str, ...]  # links that are meant to hold it


@dataclass(frozen=True)
class Holding:
    """Outcome of ``D`` tested gravity directions (fewer than asked for after an early rejection) for ``n`` objects."""

    directions: tuple[str, ...]  # tested, in order
    drift: NDArray[np.float64]  # (D, n) m, motion of the object's origin in the hand frame from start to end
    rotation: NDArray[np.float64]  # (D, n) rad, likewise
    in_contact: NDArray[np.bool_]  # (D, n) an assigned link presses at the end
    any_contact: NDArray[np.bool_]  # (D, n) some hand link presses at the end: the paper's rule
    failed_direction: str  # first direction in which an object was not held, '' if none
    steps: int  # physics steps simulated


def gravity_vector(direction: str, T_hand_object: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return gravity (3,), m/s2, hand frame, of a direction such as ``-z`` in the object frame."""
    sign = -1.0 if direction[0] == "-" else 1.0
    return GRAVITY * sign * (T_hand_object[:3, :3] @ np.array(AXES[direction[1]]))


def rotation_angle(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """Return the angle, rad, between the orientations of two transforms (4, 4)."""
    cosine = (np.trace(first[:3, :3].T @ second[:3, :3]) - 1) / 2
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)))


def hold_in_gravities(
    settings: PhysicsParameters,
    limits: ValidateParameters,
    objects: Sequence[HeldObject],
    q: NDArray[np.float64],
    squeeze_q: NDArray[np.float64],
) -> Holding:
    """Test the grasp in every direction of ``limits.gravity_directions``, in that order.

    An object is held in a direction when an assigned link presses at the end and drift and rotation are within limits.
    With ``limits.early_rejection`` the test ends after the first direction in which an object is not held.

    Args:
        q: (16,) joint angles at the start.
        squeeze_q: (16,) drive targets.
    """
    rows: list[tuple[list[float], list[float], list[bool], list[bool]]] = []
    failed, total = "", 0
    for direction in limits.gravity_directions:
        gravity = gravity_vector(direction, objects[0].T_hand_object)
        *row, steps = _hold(settings, limits, objects, q, squeeze_q, gravity)
        rows.append(tuple(row))  # type: ignore[arg-type]
        total += steps
        drift, rotation, in_contact, _ = rows[-1]
        # Each by itself: max() would pass over a drift that is not a number.
        held = all(in_contact)
        held &= all(value <= limits.drift_limit for value in drift)
        held &= all(value <= limits.rotation_limit for value in rotation)
        if not held and not failed:
            failed = direction
        if failed and limits.early_rejection:
            break
    return Holding(
        directions=tuple(limits.gravity_directions[: len(rows)]),
        drift=np.array([row[0] for row in rows]),
        rotation=np.array([row[1] for row in rows]),
        in_contact=np.array([row[2] for row in rows]),
        any_contact=np.array([row[3] for row in rows]),
        failed_direction=failed,
        steps=total,
    )


def _hold(
    settings: PhysicsParameters,
    limits: ValidateParameters,
    objects: Sequence[HeldObject],
    q: NDArray[np.float64],
    squeeze_q: NDArray[np.float64],
    gravity: NDArray[np.float64],
) -> tuple[list[float], list[float], list[bool], list[bool], int]:
    """One direction: drift, rotation, assigned contact and any contact per object, and the steps simulated."""
    world = make_world(settings, gravity)
    robot = add_robot(world, settings, False, np.eye(4), q)
    robot.set_targets(squeeze_q)
    bodies = [
        add_object(world, held.prepared, settings, held.T_hand_object, name=f"object_{index}")
        for index, held in enumerate(objects)
    ]
    steps = _run(world, robot, bodies, objects, world.steps(limits.gravity_seconds))
    drift, rotation, in_contact, any_contact = [], [], [], []
    for held, body in zip(objects, bodies, strict=True):
        pose = body.pose
        pressing = pressing_links(world, body, robot, limits.contact_impulse)
        drift.append(float(np.linalg.norm(pose[:3, 3] - held.T_hand_object[:3, 3])))
        rotation.append(rotation_angle(held.T_hand_object, pose))
        in_contact.append(not pressing.isdisjoint(held.assigned_links))
        any_contact.append(bool(pressing))
    return drift, rotation, in_contact, any_contact, steps


def _run(world: World, robot: Robot, bodies: Sequence[Body], objects: Sequence[HeldObject], steps: int) -> int:
    """Step until the time is over, an object is lost, or everything sleeps; return the steps made."""
    done = 0
    while done < steps:
        count = min(WATCH_STEPS, steps - done)
        world.step(count)
        done += count
        if robot.asleep and all(body.asleep for body in bodies):
            break
        for held, body in zip(objects, bodies, strict=True):
            if np.linalg.norm(body.pose[:3, 3] - held.T_hand_object[:3, 3]) > LOST_DISTANCE:
                return done
    return done
