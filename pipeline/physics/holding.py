"""The six-gravity holding test: a floating hand holds any number of objects while gravity pulls from all sides.

The world frame is the hand frame (fixed in space). Gravity directions are given in the frame of the
FIRST object at the grasp, and rotated into the hand frame with its pose. Every direction is a world of its own that
begins with hand and objects at rest in the grasp, in which the hand begins to squeeze. With two engines, a direction
is tested in both, and ends as badly as in the worse one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.model import Hand
from pipeline.physics.engine import GRAVITY, Body, World, pressing_links, steps_in
from pipeline.physics.world import make_world
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
class HeldGrasp:
    """A hand around its objects."""

    objects: tuple[HeldObject, ...]
    q: NDArray[np.float64]  # (J,) joint angles at the start
    squeeze_q: NDArray[np.float64]  # (J,) drive targets
    hand: Hand


@dataclass(frozen=True)
class Outcome:
    """How one gravity direction ended, per object."""

    drift: tuple[float, ...]  # m, motion of the object's origin in the hand frame from start to end
    rotation: tuple[float, ...]  # rad, likewise
    in_contact: tuple[bool, ...]  # an assigned link presses at the end
    any_contact: tuple[bool, ...]  # some hand link presses at the end: the paper's rule

    def worse(self, other: Outcome) -> Outcome:
        """Return the worse of two outcomes in everything: it is held if and only if both are."""
        return Outcome(
            drift=tuple(np.maximum(self.drift, other.drift).tolist()),  # not a number if one is not
            rotation=tuple(np.maximum(self.rotation, other.rotation).tolist()),
            in_contact=tuple(np.logical_and(self.in_contact, other.in_contact).tolist()),
            any_contact=tuple(np.logical_and(self.any_contact, other.any_contact).tolist()),
        )

    def held(self, limits: ValidateParameters) -> bool:
        """Whether every object is pressed by a link that is meant to hold it, and moved within the limits."""
        # Each by itself: max() would pass over a drift that is not a number.
        return (
            all(self.in_contact)
            and all(value <= limits.drift_limit for value in self.drift)
            and all(value <= limits.rotation_limit for value in self.rotation)
        )


@dataclass(frozen=True)
class Holding:
    """Outcome of ``D`` tested gravity directions (fewer than asked for after an early rejection) for ``n`` objects."""

    directions: tuple[str, ...]  # tested, in order
    drift: NDArray[np.float64]  # (D, n) as in Outcome, likewise the next three
    rotation: NDArray[np.float64]  # (D, n)
    in_contact: NDArray[np.bool_]  # (D, n)
    any_contact: NDArray[np.bool_]  # (D, n)
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


def judge(
    objects: Sequence[HeldObject], T_hand_object: Sequence[NDArray[np.float64]], pressing: Sequence[set[str]]
) -> Outcome:
    """Return the outcome of one direction.

    Args:
        T_hand_object: (4, 4) per object, at the end.
        pressing: per object the hand links that press on it at the end.
    """
    pairs = list(zip(objects, T_hand_object, strict=True))
    return Outcome(
        drift=tuple(float(np.linalg.norm(T[:3, 3] - held.T_hand_object[:3, 3])) for held, T in pairs),
        rotation=tuple(rotation_angle(held.T_hand_object, T) for held, T in pairs),
        in_contact=tuple(
            not links.isdisjoint(held.assigned_links) for held, links in zip(objects, pressing, strict=True)
        ),
        any_contact=tuple(bool(links) for links in pressing),
    )


def holding_of(
    directions: Sequence[str], outcomes: Sequence[Outcome], limits: ValidateParameters, steps: int
) -> Holding:
    """Return the outcomes of the first ``len(outcomes)`` of ``directions`` as arrays."""
    failed = [direction for direction, outcome in zip(directions, outcomes, strict=False) if not outcome.held(limits)]
    return Holding(
        directions=tuple(directions[: len(outcomes)]),
        drift=np.array([outcome.drift for outcome in outcomes]),
        rotation=np.array([outcome.rotation for outcome in outcomes]),
        in_contact=np.array([outcome.in_contact for outcome in outcomes]),
        any_contact=np.array([outcome.any_contact for outcome in outcomes]),
        failed_direction=failed[0] if failed else "",
        steps=steps,
    )


def hold_in_gravities(
    settings: PhysicsParameters,
    limits: ValidateParameters,
    objects: Sequence[HeldObject],
    q: NDArray[np.float64],
    squeeze_q: NDArray[np.float64],
    hand: Hand,
) -> Holding:
    """Test the grasp in every direction of ``limits.gravity_directions``, in that order.

    With ``limits.early_rejection`` the test ends after the first direction, and in it the first engine, in which an
    object is not held (see :meth:`Outcome.held`).

    Args:
        q: (J,) joint angles at the start.
        squeeze_q: (J,) drive targets.
    """
    settings = limits.for_floating_hand(settings)
    outcomes: list[Outcome] = []
    total = 0
    for direction in limits.gravity_directions:
        gravity = gravity_vector(direction, objects[0].T_hand_object)
        ends = []
        for engine in settings.engines:
            outcome, steps = _hold(settings.in_engine(engine), limits, objects, q, squeeze_q, gravity, hand)
            ends.append(outcome)
            total += steps
            if limits.early_rejection and not outcome.held(limits):
                break
        outcomes.append(reduce(Outcome.worse, ends))
        if limits.early_rejection and not outcomes[-1].held(limits):
            break
    return holding_of(limits.gravity_directions, outcomes, limits, total)


def _hold(
    settings: PhysicsParameters,
    limits: ValidateParameters,
    objects: Sequence[HeldObject],
    q: NDArray[np.float64],
    squeeze_q: NDArray[np.float64],
    gravity: NDArray[np.float64],
    hand: Hand,
) -> tuple[Outcome, int]:
    """One direction: its outcome and the steps simulated."""
    world = make_world(settings, gravity)
    bodies = place_rig(world, HeldGrasp(tuple(objects), q, squeeze_q, hand), np.eye(4))
    steps = _run(world, bodies, objects, steps_in(limits.gravity_seconds, world.frequency))
    pressing = [pressing_links(body, limits.contact_impulse) for body in bodies]
    return judge(objects, [body.pose for body in bodies], pressing), steps


def place_rig(world: World, grasp: HeldGrasp, T_world_hand: NDArray[np.float64]) -> list[Body]:
    """Add a squeezing hand at ``T_world_hand`` (4, 4) to a world, and its objects in the grasp, which are returned."""
    robot = world.add_hand(grasp.hand, T_world_hand, grasp.q)
    bodies = [
        world.add_object(held.prepared, T_world_hand @ held.T_hand_object, f"object_{index}")
        for index, held in enumerate(grasp.objects)
    ]
    world.squeeze(robot, grasp.squeeze_q)
    return bodies


def _run(world: World, bodies: Sequence[Body], objects: Sequence[HeldObject], steps: int) -> int:
    """Step until the time is over, an object is lost, or everything sleeps; return the steps made."""
    done = 0
    while done < steps:
        count = min(WATCH_STEPS, steps - done)
        world.step(count)
        done += count
        if world.asleep:
            break
        for held, body in zip(objects, bodies, strict=True):
            if np.linalg.norm(body.pose[:3, 3] - held.T_hand_object[:3, 3]) > LOST_DISTANCE:
                return done
    return done
