"""How the hand comes to a grasp: which fingers open how far, and along which straight line, so that nothing is swept.

The hand starts ``length`` metres away along ``direction`` with the opened fingers and moves straight in. A choice is
judged by a sweep: sample points of the hand (with flange and mount behind it, and with whatever it carries already)
must neither enter the object nor dip below the plane that the object stands on. Pure numpy; no physics.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.model import Hand
from pipeline.hand.moves import finger_joints, move_points, straight
from pipeline.hand.support import PLANE, Support
from pipeline.hand.surface import hand_surface, mount_surface
from pipeline.records.objects import PreparedObject
from pipeline.records.poses import transform_points
from pipeline.shapes.distance_field import signed_distance

EXTENSIONS = (0.4, 0.6, 0.8, 1.0)  # shares of the way to a straight finger
HORIZONTAL_TURNS = np.deg2rad([0, 15, -15, 30, -30, 45, -45, 60, -60])
PINCH_TILTS = (0.0, 0.25, 0.5, 1.0)  # shares of the way from the hand-object line to straight up
OPENING_SHARES = (1.0, 0.7, 0.4)  # smaller openings are tried when the full one is swept
STATION_STEP = 0.005  # m between the stations of a sweep
ENOUGH_CLEARANCE = 0.005  # m; more does not make a choice better
FINAL_STRETCH = 0.01  # m before the grasp where palm and resting fingers may be near: they touch at its end
HAND_POINTS = 500
MOUNT_POINTS = 100
CARRIED_POINTS = 512


@dataclass(frozen=True)
class HandAtObject:
    """A hand in its grasp of an object."""

    hand: Hand
    style: str  # pinch or side
    T_object_hand: NDArray[np.float64]  # (4, 4)
    # (J,) rad; joints of fingers that do not open keep these (for a second object: with the fingers that hold the first
    # one already squeezing).
    q: NDArray[np.float64]
    contact_candidates: NDArray[np.int64]  # (n,) indices into ``hand.contact_points`` of the contacts with this object


@dataclass(frozen=True)
class Approach:
    """A straight way in."""

    open_q: NDArray[np.float64]  # (J,) rad
    direction: NDArray[np.float64]  # (3,) unit, object frame, from the grasp towards where the hand comes from
    length: float  # m
    penetrations: int  # swept sample points that enter the object or the support plane
    clearance: float  # m, smallest distance to the object on the way, of all points but those that touch at its end


def choose_approach(
    grasp: HandAtObject,
    prepared: PreparedObject,
    opening: float,
    lengths: Sequence[float],
    carried: Sequence[tuple[PreparedObject, NDArray[np.float64]]] = (),
    tolerance: float = 0.001,
    support: Support = PLANE,
) -> Approach:
    """Return the opening and direction whose sweep touches least; among equals the roomier, then the earlier one.

    In a ``pinch`` the fingers of the contacts open horizontally away from the object's axis, and the hand comes along
    the hand-object line or more from above. In a ``side`` grasp the finger opposite the palm opens, and the hand comes
    along that line or horizontally, up to 60 degrees beside it; to an object on a post also from above.

    Args:
        prepared: the object to be approached; it stands on a support that ends at z = ``prepared.bottom`` of its frame.
        opening: how far the contact points of the opening fingers move away, m.
        lengths: lengths of the straight line, m; the first one that touches nothing is taken.
        carried: objects that the hand holds already, with their ``T_hand_object`` (4, 4).
        tolerance: depth below which a point does not count as touching, m.
        support: what the object stands on.
    """
    hand, T_object_hand = grasp.hand, grasp.T_object_hand
    fingers = sorted({hand.contact_finger[c] for c in grasp.contact_candidates} - {"palm"})
    directions = approach_directions(T_object_hand, grasp.style, from_above=support != PLANE)
    openings = open_postures(grasp, opening)
    seen: list[NDArray[np.float64]] = []
    rigid = [np.zeros((0, 3)) if hand.mount is None else mount_surface(hand, MOUNT_POINTS)]
    rigid += [transform_points(T, held.surface_points[:CARRIED_POINTS]) for held, T in carried]
    best: tuple[tuple[int, float], Approach] | None = None
    for length in lengths:
        for open_q in _replayed(openings, seen):
            points, is_opening = _sample(hand, open_q, fingers, np.concatenate(rigid))
            points = transform_points(T_object_hand, points)
            for direction in directions:
                penetrations, clearance = _sweep(prepared, support, points, is_opening, direction, length, tolerance)
                rank = (penetrations, -round(min(clearance, ENOUGH_CLEARANCE), 4))
                if best is None or rank < best[0]:
                    best = rank, Approach(open_q, direction, float(length), penetrations, clearance)
                if rank == (0, -ENOUGH_CLEARANCE):
                    return best[1]  # nothing later can be better
        if best is not None and best[1].penetrations == 0:
            break
    assert best is not None
    return best[1]


def approach_directions(
    T_object_hand: NDArray[np.float64], style: str, from_above: bool = False
) -> list[NDArray[np.float64]]:
    """Return candidate directions (3,), unit, object frame, from the grasp outwards; the preferred one first.

    Args:
        from_above: a side grasp may come from above as well, as a pinch does.
    """
    line = T_object_hand[:3, 3] / np.linalg.norm(T_object_hand[:3, 3])
    up = np.array([0.0, 0.0, 1.0])
    tilted = [(1 - share) * line + share * up for share in PINCH_TILTS]
    tilted = [direction / np.linalg.norm(direction) for direction in tilted]
    if style == "pinch":
        return tilted
    flat = np.array([line[0], line[1], 0.0])
    if np.linalg.norm(flat) < 1e-6:
        return [line]
    flat /= np.linalg.norm(flat)
    turned = [
        np.array([np.cos(turn) * flat[0] - np.sin(turn) * flat[1], np.sin(turn) * flat[0] + np.cos(turn) * flat[1], 0])
        for turn in HORIZONTAL_TURNS
    ]
    return [line, *turned, *(tilted[1:] if from_above else [])]


def open_postures(grasp: HandAtObject, opening: float) -> Iterator[NDArray[np.float64]]:
    """Yield candidate joint angles (J,) with the grasping fingers opened; the preferred one first.

    Contact points move horizontally (in the object frame) away from the object's vertical axis; for a side grasp
    postures between the grasp and the straight finger follow.
    """
    hand, T_object_hand, q, contact_candidates = grasp.hand, grasp.T_object_hand, grasp.q, grasp.contact_candidates
    movable = contact_candidates[[hand.contact_finger[c] != "palm" for c in contact_candidates]]
    if len(movable) == 0:
        yield q
        return
    fingers = sorted({hand.contact_finger[c] for c in movable})
    points = points_on_links(link_poses(hand, q[None]), hand.contact_link[movable], hand.contact_points[movable])[0]
    outward = transform_points(T_object_hand, points) * [1.0, 1.0, 0.0]
    length = np.linalg.norm(outward, axis=1, keepdims=True)
    outward = np.where(length > 1e-3, outward / np.maximum(length, 1e-9), [0.0, 0.0, 1.0]) @ T_object_hand[:3, :3]
    for share in OPENING_SHARES:
        yield move_points(
            hand,
            q,
            list(hand.contact_link[movable]),
            hand.contact_points[movable],
            share * opening * outward,
            finger_joints(fingers, hand),
        )
    if grasp.style == "side" and all(finger in hand.straight for finger in fingers):
        own = finger_joints(fingers, hand)
        for share in EXTENSIONS:
            extended = q.copy()
            extended[own] = (1 - share) * q[own] + share * straight(fingers, hand)
            yield extended


def _replayed(source: Iterator[NDArray[np.float64]], seen: list[NDArray[np.float64]]) -> Iterator[NDArray[np.float64]]:
    """Yield ``seen``, then what is left of ``source``, and remember it there: most often the first posture will do."""
    yield from list(seen)
    for posture in source:
        seen.append(posture)
        yield posture


def _sample(
    hand: Hand, open_q: NDArray[np.float64], fingers: Sequence[str], rigid: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return points (n, 3), hand frame, of hand and ``rigid``, and which of them are on the opening fingers."""
    link, local = hand_surface(HAND_POINTS, hand)
    points = points_on_links(link_poses(hand, open_q[None]), link, local)[0]
    opening = [hand.link(name) for finger in fingers for name in hand.finger_links[finger]]
    is_opening = np.concatenate([np.isin(link, opening), np.zeros(len(rigid), dtype=bool)])
    return np.concatenate([points, rigid]), is_opening


def _sweep(
    prepared: PreparedObject,
    support: Support,
    points: NDArray[np.float64],
    is_opening: NDArray[np.bool_],
    direction: NDArray[np.float64],
    length: float,
    tolerance: float,
) -> tuple[int, float]:
    """Return how many ``points`` (n, 3), object frame at the grasp, touch on the way, and the clearance, m."""
    stations = np.linspace(0.0, length, max(2, round(length / STATION_STEP) + 1))
    ends = points + stations[-1] * direction
    lowest, highest = np.minimum(points, ends), np.maximum(points, ends)
    touches = np.asarray(lowest[:, 2] < support.level(prepared.bottom, lowest, highest) - tolerance)
    low = prepared.vertices.min(0) - ENOUGH_CLEARANCE
    high = prepared.vertices.max(0) + ENOUGH_CLEARANCE
    passing = np.flatnonzero(((highest > low) & (lowest < high)).all(-1))  # whose way may lead through the box
    swept = points[passing, None] + stations[:, None] * direction  # (passing, stations, 3)
    near = ((swept > low) & (swept < high)).all(-1)
    if not near.any():
        return int(touches.sum()), ENOUGH_CLEARANCE
    owner, station = np.nonzero(near)
    distance = signed_distance(prepared, swept[near])
    owner = passing[owner]
    touches[owner[distance < -tolerance]] = True
    judged = is_opening[owner] | (stations[station] >= FINAL_STRETCH)
    return int(touches.sum()), float(distance[judged].min(initial=ENOUGH_CLEARANCE))
