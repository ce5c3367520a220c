"""The tabletop test: a floating hand comes to an object on a support, closes, and keeps it when the support goes away.

World frame = object frame at the grasp, z up. The hand's root is fixed at ``T_object_hand``; the support, with the
object standing on it, is carried to the hand along the approach line and later drops away. To the object this is the
same as a hand that moves in and lifts, and no arm has to be simulated.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.approach import Approach
from pipeline.hand.support import PLANE, Support
from pipeline.physics.engine import Carrier, Robot, World, pressing_links, steps_in
from pipeline.physics.holding import WATCH_STEPS, HeldGrasp, rotation_angle
from pipeline.physics.world import make_world
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

    def worse(self, other: TablePick) -> TablePick:
        """Return the worse of two outcomes in everything."""
        return TablePick(
            push=float(np.maximum(self.push, other.push)),  # not a number if one is not
            touched_support=self.touched_support or other.touched_support,
            drift=float(np.maximum(self.drift, other.drift)),
            rotation=float(np.maximum(self.rotation, other.rotation)),
            in_contact=self.in_contact and other.in_contact,
        )


@dataclass(frozen=True)
class _Rig:
    world: World
    robot: Robot
    support: Carrier
    impulse: float  # N s that count as touching


def pick_from_support(
    settings: PhysicsParameters,
    limits: ValidateParameters,
    grasp: HeldGrasp,
    T_object_hand: NDArray[np.float64],
    approach: Approach,
    stand: Support = PLANE,
) -> TablePick:
    """Run the tabletop test, in every engine of the settings: the outcome is the worse one.

    Args:
        grasp: a hand around one object, which stands on the plane z = ``bottom`` of its frame.
        T_object_hand: (4, 4) the pose of that hand, of which ``grasp`` holds the inverse.
        approach: the opened hand, and its way in.
        stand: what the object stands on.
    """
    settings = limits.for_floating_hand(settings)
    picks = [
        _pick_in_one(settings.in_engine(engine), limits, grasp, T_object_hand, approach, stand)
        for engine in settings.engines
    ]
    return reduce(TablePick.worse, picks)


def _pick_in_one(
    settings: PhysicsParameters,
    limits: ValidateParameters,
    grasp: HeldGrasp,
    T_object_hand: NDArray[np.float64],
    approach: Approach,
    stand: Support,
) -> TablePick:
    """Run the test in one engine."""
    (held,) = grasp.objects
    world = make_world(settings)
    robot = world.add_hand(grasp.hand, T_object_hand, approach.open_q)
    away = -approach.length * approach.direction
    half = SUPPORT_HALF if stand == PLANE else np.array([stand.half_width, stand.half_width, stand.height / 2])
    support_home = np.array([0.0, 0.0, held.prepared.bottom - half[2]])
    support = world.add_carrier(half, _at(support_home + away), "support")
    body = world.add_object(held.prepared, _at(away), "object")
    rig = _Rig(world, robot, support, limits.contact_impulse)

    touched = _carry(rig, support_home + away, support_home, APPROACH_SECONDS)
    push = float(np.linalg.norm(body.pose[:3, 3]))
    touched |= _close(rig, approach.open_q, grasp.q, CLOSE_SECONDS)
    touched |= _close(rig, grasp.q, grasp.squeeze_q, SQUEEZE_SECONDS)
    squeezed = body.pose
    _carry(rig, support_home, support_home - [0.0, 0.0, DROP_DISTANCE], DROP_SECONDS)
    world.step(steps_in(HOLD_SECONDS, world.frequency))
    final = body.pose
    return TablePick(
        push=push,
        touched_support=touched,
        drift=float(np.linalg.norm(final[:3, 3] - squeezed[:3, 3])),
        rotation=rotation_angle(squeezed, final),
        in_contact=not pressing_links(body, limits.contact_impulse).isdisjoint(held.assigned_links),
    )


def _at(position: NDArray[np.float64]) -> NDArray[np.float64]:
    T = np.eye(4)
    T[:3, 3] = position
    return T


def _touching(rig: _Rig) -> bool:
    return bool(pressing_links(rig.support, rig.impulse))


def _carry(rig: _Rig, start: NDArray[np.float64], end: NDArray[np.float64], seconds: float) -> bool:
    """Move the support from ``start`` to ``end`` (3,), at rest at both; return whether the hand touched it."""
    touched, steps = False, steps_in(seconds, rig.world.frequency)
    for step in range(1, steps + 1):
        share = step / steps
        rig.support.carry_to(start + (3 * share**2 - 2 * share**3) * (end - start))
        rig.world.step()
        touched |= step % WATCH_STEPS == 0 and _touching(rig)
    return touched


def _close(rig: _Rig, start: NDArray[np.float64], end: NDArray[np.float64], seconds: float) -> bool:
    """Move the drive targets from ``start`` to ``end`` (J,); return whether the hand touched the support."""
    touched, steps = False, steps_in(seconds, rig.world.frequency)
    for step in range(1, steps + 1):
        rig.robot.set_targets(start + step / steps * (end - start))
        rig.world.step()
        touched |= step % WATCH_STEPS == 0 and _touching(rig)
    return touched
