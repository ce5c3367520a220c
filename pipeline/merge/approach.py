"""How the hand comes to each object without knocking it over or dropping what it holds.

A curled ring finger is a hook: moved straight in, it sweeps through the object that it is about to hold. Several
openings of the ring finger and several straight lines are therefore swept against the signed distance of the object,
with everything that travels along: fingers, palm, flange, mount and the held object 0.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.allegro import load_hand
from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.surface import hand_surface, mount_surface
from pipeline.merge.clearance import HAND_POINTS, hand_object_clearance, links_of, self_clearance, support_height
from pipeline.merge.grasps import PINCH_JOINTS, RING_JOINTS, RING_LINKS, MergedGrasp
from pipeline.records.distance import signed_distance
from pipeline.records.objects import PreparedObject
from pipeline.records.poses import transform_points

EXTENDED_RING = np.array([0.0, -0.1, 0.0, 0.0])  # rad, straight and a little back
EXTENSION_SHARES = (0.4, 0.6, 0.8, 1.0)  # of the way from the grasp to the extended ring
HEADINGS = (0, 15, -15, 30, -30, 45, -45, 60, -60)  # degrees about the line from object to hand
SWEEP_STEP = 0.005  # m
PATH_SHARES = (0.25, 0.5, 0.75, 1.0)  # where a joint-space motion of the ring is looked at
FIRST_APPROACH_LENGTH = 0.05  # m, from the pre-grasp straight in
ENOUGH = 0.005  # m; a ring finger farther from everything than this is out of the way


@dataclass(frozen=True)
class SecondApproach:
    """A ring posture and a straight line to object 1."""

    open_q: NDArray[np.float64]  # (16,) targets: pinching fingers squeeze, ring open
    direction: NDArray[np.float64]  # (3,) object 1 frame, unit, horizontal, towards where the hand comes from
    length: float  # m
    penetrations: int  # points and steps of the sweep that lie in something; 0 is free


def sweep_counts(
    item: PreparedObject,
    points: NDArray[np.float64],
    direction: NDArray[np.float64],
    offsets: NDArray[np.float64],
    tolerance: float,
) -> NDArray[np.int64]:
    """Return how many points (n, 3), moved by each offset (s,) along a direction, lie in an object: (s,) counts.

    Args:
        points: object frame, m.
        tolerance: m; a point counts when it is deeper than this.
    """
    moved = points[None] + offsets[:, None, None] * direction
    near = ((moved > item.vertices.min(0)) & (moved < item.vertices.max(0))).all(-1)
    counts = np.zeros(len(offsets), dtype=np.int64)
    step = np.nonzero(near)[0]
    np.add.at(counts, step, signed_distance(item, moved[near]) < -tolerance)
    return counts


def _with_ring(q: NDArray[np.float64], ring: NDArray[np.float64]) -> NDArray[np.float64]:
    result = q.copy()
    result[RING_JOINTS] = ring
    return result


def _ring_openings(grasp: MergedGrasp) -> Iterator[NDArray[np.float64]]:
    """Yield ring postures (4,): the opening of validation, then ever further towards the extended finger."""
    closed = grasp.second.q[RING_JOINTS]
    yield grasp.second.open_q[RING_JOINTS]
    for share in EXTENSION_SHARES:
        yield closed + share * (EXTENDED_RING - closed)


def _headings(grasp: MergedGrasp) -> list[NDArray[np.float64]]:
    """Horizontal unit vectors, object 1 frame: from the object to the hand, then turned to both sides."""
    x, y = grasp.second.T_object_hand[:2, 3]
    begin = np.arctan2(y, x)
    angles = begin + np.radians(HEADINGS)
    return [np.array([np.cos(angle), np.sin(angle), 0.0]) for angle in angles]


def _travelling_points(
    grasp: MergedGrasp, object0: PreparedObject
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Return points (n, 3), object 1 frame, of all that travels but the ring, and the ring's links and samples."""
    hand = load_hand()
    links, samples = hand_surface(HAND_POINTS)
    ring = np.isin(links, links_of(hand, RING_LINKS))
    T_hand_link = link_poses(hand, grasp.q[None])
    in_hand = [
        points_on_links(T_hand_link, links[~ring], samples[~ring])[0],
        mount_surface(),
        transform_points(grasp.T_hand_object0, object0.surface_points[:1000]),
    ]
    return transform_points(grasp.second.T_object_hand, np.concatenate(in_hand)), links[ring], samples[ring]


def second_approach(
    grasp: MergedGrasp,
    object0: PreparedObject,
    object1: PreparedObject,
    lengths: Sequence[float],
    tolerance: float,
) -> SecondApproach:
    """Choose the opening of the ring and the straight line to object 1 that sweep through the least.

    Among free ones the longest line wins, then the validated opening and the heading straight away from the object.

    Args:
        lengths: m, candidates for the length of the line.
        tolerance: m, see :func:`sweep_counts`.
    """
    hand = load_hand()
    rest, ring_links, ring_samples = _travelling_points(grasp, object0)
    offsets = np.arange(0.0, max(lengths) + SWEEP_STEP / 2, SWEEP_STEP)
    headings = _headings(grasp)
    rest_counts = [sweep_counts(object1, rest, heading, offsets, tolerance).cumsum() for heading in headings]
    last_steps = {length: int(np.searchsorted(offsets, length + SWEEP_STEP / 2)) - 1 for length in lengths}
    best: tuple[tuple[int, float], SecondApproach] | None = None
    for ring in _ring_openings(grasp):
        blocked = _ring_is_blocked(grasp, ring, object0, object1, tolerance)
        T_hand_link = link_poses(hand, _with_ring(grasp.q, ring)[None])
        points = points_on_links(T_hand_link, ring_links, ring_samples)[0]
        points = transform_points(grasp.second.T_object_hand, points)
        for heading, others in zip(headings, rest_counts, strict=True):
            counts = others + sweep_counts(object1, points, heading, offsets, tolerance).cumsum()
            for length, step in last_steps.items():
                count = int(counts[step]) + blocked
                if best is None or (count, -length) < best[0]:
                    open_q = _with_ring(grasp.squeeze_q, ring)
                    best = (count, -length), SecondApproach(open_q, heading, length, count)
        if best is not None and best[0] == (0, -max(lengths)):
            break
    assert best is not None
    return best[1]


def _ring_is_blocked(
    grasp: MergedGrasp,
    ring: NDArray[np.float64],
    object0: PreparedObject,
    object1: PreparedObject,
    tolerance: float,
) -> int:
    """Count what an open ring would touch: 1 each for object 0, support and other fingers, on its way to the grasp."""
    hand = load_hand()
    links = links_of(hand, RING_LINKS)
    closed = grasp.q[RING_JOINTS]
    blocked = 0
    for share in PATH_SHARES:
        q = _with_ring(grasp.q, closed + share * (ring - closed))
        blocked += hand_object_clearance(q, links, object0, grasp.T_hand_object0) < -tolerance
        blocked += support_height(q, grasp.second.T_object_hand, object1.bottom, links) < -tolerance
        blocked += self_clearance(q) < -tolerance
    return blocked


def first_opening(
    grasp: MergedGrasp, object0: PreparedObject, tolerance: float
) -> tuple[NDArray[np.float64], bool]:
    """Choose the hand's posture for the approach to object 0, and tell whether it touches nothing.

    Pinching fingers as validation opened them; the ring finger out of the way: extended where object 0 and the
    support allow it, else less so, else as in the validated grasp.

    Returns:
        Joint angles (16,), and whether the ring finger stays clear of object 0, of the support of object 0 and of
        the other fingers, both open and at the grasp.
    """
    hand = load_hand()
    links = links_of(hand, RING_LINKS)
    first = grasp.first
    postures = [share * EXTENDED_RING + (1 - share) * first.q[RING_JOINTS] for share in (1.0, 0.75, 0.5, 0.25, 0.0)]
    best: tuple[float, NDArray[np.float64]] | None = None
    for ring in postures:
        opened = _with_ring(first.open_q, ring)
        at_grasp = _with_ring(first.q, ring)
        points = _link_points(opened, links)
        offsets = np.arange(0.0, FIRST_APPROACH_LENGTH, SWEEP_STEP)[:, None, None] * first.approach_direction
        swept = signed_distance(object0, transform_points(first.T_object_hand, points)[None] + offsets).min()
        clearance = min(
            float(swept),
            hand_object_clearance(at_grasp, links, object0, grasp.T_hand_object0),
            support_height(opened, first.T_object_hand, object0.bottom, links),
            self_clearance(opened),
            self_clearance(at_grasp),
        )
        if best is None or clearance > best[0]:
            best = clearance, opened
        if clearance >= ENOUGH:
            break
    assert best is not None
    return best[1], best[0] >= -tolerance


def _link_points(q: NDArray[np.float64], links: NDArray[np.int64]) -> NDArray[np.float64]:
    """Surface points (n, 3) of some links in the hand frame at ``q``."""
    sample_links, samples = hand_surface(HAND_POINTS)
    chosen = np.isin(sample_links, links)
    return points_on_links(link_poses(load_hand(), q[None]), sample_links[chosen], samples[chosen])[0]
