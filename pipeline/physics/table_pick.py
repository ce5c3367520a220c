"""The tabletop test: a floating hand comes to an object on a support, closes, and keeps it when the support goes away.

World frame = object frame at the grasp, z up. The hand's root is fixed at ``T_object_hand``; the support, with the
object standing on it, is carried to the hand along the approach line and later drops away. To the object this is the
same as a hand that moves in and lifts, and no arm has to be simulated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.model import Hand
from pipeline.hand.support import PLANE, Support
from pipeline.physics.bodies import Body, add_object, add_support
from pipeline.physics.contacts import pressing_links
from pipeline.physics.holding import WATCH_STEPS, rotation_angle
from pipeline.physics.robots import Robot, add_robot
from pipeline.physics.world import World, make_world
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.validate import ValidateParameters

SUPPORT_HALF = np.array([0.2, 0.2, 0.02])  # m
APPROACH_SECONDS = 1.0
CLOSE_SECONDS = 0.5
SQUEEZE_SECONDS = 0.5
DROP_SECONDS = 1.0
DROP_DISTANCE = 0.2  # m
HOLD_SECONDS = 1.0


@dataclass(frozen=True)
class TablePick:
    """Outcome of the tabletop test."""

    push: float  # m, how far the object moved from where it stands before the fingers closed
    touched_support: bool  # a hand link pressed on the support before it went away
    drift: float  # m, motion of the object in the hand from the end of the squeeze to the end of the hold
    rotation: float  # rad, likewise
    in_contact: bool  # an assigned link presses at the end


@dataclass(frozen=True)
class _Rig:
    world: World
    robot: Robot
    support: Body
    body: Body
    impulse: float  # N s that count as touching


def pick_from_support(
    settings: PhysicsParameters,
    limits: ValidateParameters,
    prepared: PreparedObject,
    T_object_hand: NDArray[np.float64],
    q: NDArray[np.float64],
    squeeze_q: NDArray[np.float64],
    open_q: NDArray[np.float64],
    direction: NDArray[np.float64],
    length: float,
    assigned_links: tuple[str, ...],
    stand: Support,
    hand: Hand,
) -> TablePick:
    """Run the tabletop test.

    Args:
        T_object_hand: (4, 4) the grasp; the object stands on the plane z = ``prepared.bottom``.
        q, squeeze_q, open_q: (J,) joint angles at the grasp, drive targets of the squeeze, and for the approach, rad.
        direction: (3,) unit, object frame, from the grasp towards where the hand comes from.
        length: of the approach, m.
        stand: what the object stands on.
    """
    settings = limits.for_floating_hand(settings)
    world = make_world(settings)
    robot = add_robot(world, settings, False, T_object_hand, open_q, hand)
    away = -length * direction
    half = SUPPORT_HALF if stand == PLANE else np.array([stand.half_width, stand.half_width, stand.height / 2])
    support_home = np.array([0.0, 0.0, prepared.bottom - half[2]])
    support = add_support(world, settings, half, _at(support_home + away))
    body = add_object(world, prepared, settings, _at(away))
    rig = _Rig(world, robot, support, body, limits.contact_impulse)

    touched = _carry(rig, support_home + away, support_home, APPROACH_SECONDS)
    push = float(np.linalg.norm(body.pose[:3, 3]))
    touched |= _close(rig, open_q, q, CLOSE_SECONDS)
    touched |= _close(rig, q, squeeze_q, SQUEEZE_SECONDS)
    squeezed = body.pose
    _carry(rig, support_home, support_home - [0.0, 0.0, DROP_DISTANCE], DROP_SECONDS)
    world.step(world.steps(HOLD_SECONDS))
    final = body.pose
    return TablePick(
        push=push,
        touched_support=touched,
        drift=float(np.linalg.norm(final[:3, 3] - squeezed[:3, 3])),
        rotation=rotation_angle(squeezed, final),
        in_contact=not pressing_links(world, body, robot, limits.contact_impulse).isdisjoint(assigned_links),
    )


def _at(position: NDArray[np.float64]) -> NDArray[np.float64]:
    T = np.eye(4)
    T[:3, 3] = position
    return T


def _touching(rig: _Rig) -> bool:
    return bool(pressing_links(rig.world, rig.support, rig.robot, rig.impulse))


def _carry(rig: _Rig, start: NDArray[np.float64], end: NDArray[np.float64], seconds: float) -> bool:
    """Move the support from ``start`` to ``end`` (3,), at rest at both; return whether the hand touched it."""
    touched, steps = False, rig.world.steps(seconds)
    for step in range(1, steps + 1):
        share = step / steps
        rig.support.carry_to(start + (3 * share**2 - 2 * share**3) * (end - start))
        rig.world.step()
        touched |= step % WATCH_STEPS == 0 and _touching(rig)
    return touched


def _close(rig: _Rig, start: NDArray[np.float64], end: NDArray[np.float64], seconds: float) -> bool:
    """Move the drive targets from ``start`` to ``end`` (J,); return whether the hand touched the support."""
    touched, steps = False, rig.world.steps(seconds)
    for step in range(1, steps + 1):
        rig.robot.set_targets(start + step / steps * (end - start))
        rig.world.step()
        touched |= step % WATCH_STEPS == 0 and _touching(rig)
    return touched
