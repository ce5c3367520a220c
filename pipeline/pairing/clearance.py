"""Static distances of a joined grasp: between the objects, and of hand and objects to what they must not touch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.model import Hand
from pipeline.hand.parts import part_links
from pipeline.hand.support import PLANE, Support
from pipeline.hand.surface import hand_surface, mount_surface
from pipeline.pairing.grasps import JoinedGrasp, fingers_of
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.hand import PALM
from pipeline.records.poses import inverse_pose, transform_points
from pipeline.shapes.distance_field import signed_distance

HAND_POINTS = 2000  # about 5 mm apart
FAR = 1.0  # m, the distance to nothing at all


@dataclass(frozen=True)
class PosedHand:
    """Links and surface points of the hand at one posture, in the hand frame."""

    hand: Hand
    T_hand_link: NDArray[np.float64]  # (L, 4, 4)
    sample_links: NDArray[np.int64]  # (n,)
    samples: NDArray[np.float64]  # (n, 3) m

    def points_on(self, links: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the surface points (m, 3) on some links."""
        return self.samples[np.isin(self.sample_links, links)]


def posed_hand(hand: Hand, q: NDArray[np.float64]) -> PosedHand:
    """Return the hand at joint angles ``q`` (J,), rad."""
    T_hand_link = link_poses(hand, q[None])
    links, samples = hand_surface(HAND_POINTS, hand)
    return PosedHand(hand, T_hand_link[0], links, points_on_links(T_hand_link, links, samples)[0])


def links_of(hand: Hand, names: Sequence[str]) -> NDArray[np.int64]:
    """Return link indices of some link names."""
    return np.array([hand.link(name) for name in names], dtype=np.int64)


def palm_side_bases(hand: Hand) -> NDArray[np.int64]:
    """Return the bases of the fingers that stand beside the palm, in its plane: all but those that oppose others."""
    bases = [base for finger, base in hand.finger_base.items() if finger not in hand.opposing]
    return links_of(hand, [base for base in bases if base is not None])


def holding_links(hand: Hand, fingers: Sequence[str]) -> NDArray[np.int64]:
    """Return the links that may touch an object held by ``fingers``."""
    return links_of(hand, [link for finger in fingers for link in hand.finger_links[finger]])


def distance_to_links(
    posed: PosedHand, links: NDArray[np.int64], points: NDArray[np.float64], below: float = FAR
) -> float:
    """Return the smallest signed distance, m, of ``points`` (n, 3), hand frame, to the collision shapes of some links.

    Exact distance to boxes and balls, positive outside. Shapes and points are only looked at when their bounding balls
    could come nearer than what is known already.

    Args:
        below: m; returned when nothing is nearer.
    """
    hand, T_hand_link = posed.hand, posed.T_hand_link
    boxes = np.flatnonzero(np.isin(hand.box_link, links))
    balls = np.flatnonzero(np.isin(hand.sphere_link, links))
    T_hand_box = T_hand_link[hand.box_link[boxes]] @ hand.box_pose[boxes]
    ball_pose = T_hand_link[hand.sphere_link[balls]]
    ball_centre = np.einsum("nij,nj->ni", ball_pose[:, :3, :3], hand.sphere_centre[balls]) + ball_pose[:, :3, 3]
    centres = np.concatenate([T_hand_box[:, :3, 3], ball_centre])
    radii = np.concatenate([np.linalg.norm(hand.box_half[boxes], axis=1), hand.sphere_radius[balls]])
    middle = (points.min(0) + points.max(0)) / 2
    reach = np.linalg.norm(points - middle, axis=1).max()
    at_least = np.linalg.norm(centres - middle, axis=1) - radii - reach
    best = below
    for shape in np.argsort(at_least, kind="stable"):
        if at_least[shape] >= best:
            break
        to_centre = np.linalg.norm(points - centres[shape], axis=1) - radii[shape]
        if shape >= len(boxes):
            best = min(best, float(to_centre.min()))
            continue
        near = points[to_centre < best]
        if len(near):
            beyond = np.abs(transform_points(inverse_pose(T_hand_box[shape]), near)) - hand.box_half[boxes[shape]]
            outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
            best = min(best, float((outside + np.minimum(beyond.max(1), 0.0)).min()))
    return best


def object_clearance(grasp: JoinedGrasp, objects: Sequence[PreparedObject]) -> float:
    """Return the smallest signed distance between two of the objects, m: surface points of each to the other."""
    distances = []
    for (first, T_hand_first), (second, T_hand_second) in combinations(zip(objects, grasp.T_hand_held, strict=True), 2):
        T_first_second = inverse_pose(T_hand_first) @ T_hand_second
        of_second = transform_points(T_first_second, second.surface_points)
        of_first = transform_points(inverse_pose(T_first_second), first.surface_points)
        distances += [signed_distance(first, of_second).min(), signed_distance(second, of_first).min()]
    return float(min(distances))


def hand_object_clearance(
    posed: PosedHand, links: NDArray[np.int64], item: PreparedObject, T_hand_object: NDArray[np.float64]
) -> float:
    """Return the smallest signed distance, m, between some links of a hand and an object.

    Surface points of the links to the object and surface points of the object to the links: edges of either are seen.
    """
    on_hand = posed.points_on(links)
    if len(on_hand) == 0:
        return FAR
    in_object = float(signed_distance(item, transform_points(inverse_pose(T_hand_object), on_hand)).min())
    return distance_to_links(posed, links, transform_points(T_hand_object, item.surface_points), in_object)


def hand_clearance(grasp: JoinedGrasp, posed: PosedHand, objects: Sequence[PreparedObject]) -> float:
    """Return the smallest signed distance, m, of an object to links that do not hold it, the thumb's base included.

    The bases of the other fingers are left out where the palm holds: they lie in its plane. :func:`base_clearance`
    looks after them.

    Args:
        posed: the hand at ``grasp.held_q``.
    """
    hand = posed.hand
    everything = np.arange(len(hand.link_names))
    distances = []
    for single, item, T_hand_object in zip(grasp.singles, objects, grasp.T_hand_held, strict=True):
        allowed = holding_links(hand, single.fingers)
        if PALM in single.fingers:
            allowed = np.concatenate([allowed, palm_side_bases(hand)])
        distances.append(hand_object_clearance(posed, np.setdiff1d(everything, allowed), item, T_hand_object))
    return min(distances)


def base_clearance(grasp: JoinedGrasp, posed: PosedHand, objects: Sequence[PreparedObject]) -> float:
    """Return the smallest signed distance, m, of the objects that the palm holds to the finger bases beside it."""
    bases = palm_side_bases(posed.hand)
    return min(
        hand_object_clearance(posed, bases, item, T_hand_object) if PALM in single.fingers else FAR
        for single, item, T_hand_object in zip(grasp.singles, objects, grasp.T_hand_held, strict=True)
    )


def finger_clearance(posed: PosedHand, fingers: Sequence[str]) -> float:
    """Return the smallest signed distance, m, between some fingers and all others.

    The other pairs of links stand as in a validated grasp; only these fingers have got new neighbours.
    """
    hand = posed.hand
    own = links_of(hand, part_links(fingers, hand))
    others = np.setdiff1d(np.arange(1, len(hand.link_names)), own)
    to_others = distance_to_links(posed, others, posed.points_on(own))
    return distance_to_links(posed, own, posed.points_on(others), to_others)


def self_clearance(grasp: JoinedGrasp, posed: PosedHand) -> float:
    """Return the smallest signed distance, m, between fingers that come from different grasps."""
    return min(finger_clearance(posed, fingers_of([group])) for group in grasp.groups[1:])


def mount_height(
    hand: Hand, T_object_hand: NDArray[np.float64], item: PreparedObject, support: Support = PLANE
) -> float:
    """Return the height, m, of flange and mount over what the object stands on, with the hand at its grasp."""
    return _height(transform_points(T_object_hand, mount_surface(hand)), item.bottom, support)


def support_height(
    posed: PosedHand,
    T_object_hand: NDArray[np.float64],
    top: float,
    links: NDArray[np.int64] | None = None,
    support: Support = PLANE,
) -> float:
    """Return the height, m, of the lowest surface point of a hand over a support that ends at z = ``top``.

    Args:
        T_object_hand: the hand in the frame of the object that stands on the support.
        links: consider only these.
    """
    points = posed.samples if links is None else posed.points_on(links)
    return _height(transform_points(T_object_hand, points), top, support)


def held_object_height(
    grasp: JoinedGrasp, pick: int, objects: Sequence[PreparedObject], support: Support = PLANE
) -> float:
    """Return the height, m, of the objects held already over what object number ``pick`` stands on."""
    T_object_hand, bottom = grasp.singles[pick].T_object_hand, objects[pick].bottom
    return min(
        _height(transform_points(T_object_hand @ T_hand_held, held.surface_points), bottom, support)
        for held, T_hand_held in zip(objects[:pick], grasp.T_hand_held[:pick], strict=True)
    )


def _height(points: NDArray[np.float64], top: float, support: Support) -> float:
    return float((points[:, 2] - support.level(top, points)).min())
