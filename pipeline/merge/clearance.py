"""Static distances of a merged grasp: between the objects, and of hand and objects to what they must not touch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.allegro import FINGER_LINKS, Hand, load_hand
from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.surface import hand_surface, mount_surface
from pipeline.merge.grasps import RING_LINKS, MergedGrasp
from pipeline.records.distance import signed_distance
from pipeline.records.objects import PreparedObject
from pipeline.records.poses import inverse_pose, transform_points

HAND_POINTS = 2000  # about 5 mm apart
PALM_SIDE_BASES = ("link_0.0", "link_4.0", "link_8.0")
FAR = 1.0  # m, the distance to nothing at all


def links_of(hand: Hand, names: Sequence[str]) -> NDArray[np.int64]:
    """Return link indices of some link names."""
    return np.array([hand.link(name) for name in names], dtype=np.int64)


def holding_links(hand: Hand, fingers: Sequence[str]) -> NDArray[np.int64]:
    """Return the links that may touch an object held by ``fingers``."""
    return links_of(hand, [link for finger in fingers for link in FINGER_LINKS[finger]])


def distance_to_links(
    hand: Hand, T_hand_link: NDArray[np.float64], links: NDArray[np.int64], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return signed distances (n,) of ``points`` (n, 3), hand frame, to the nearest collision shape of some links.

    Exact distance to boxes and balls, positive outside; ``FAR`` when the links carry no shape.

    Args:
        T_hand_link: (L, 4, 4), one hand.
    """
    best = np.full(len(points), FAR)
    for link, pose, half in zip(hand.box_link, hand.box_pose, hand.box_half, strict=True):
        if link in links:
            beyond = np.abs(transform_points(inverse_pose(T_hand_link[link] @ pose), points)) - half
            outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
            best = np.minimum(best, outside + np.minimum(beyond.max(1), 0.0))
    for link, centre, radius in zip(hand.sphere_link, hand.sphere_centre, hand.sphere_radius, strict=True):
        if link in links:
            middle = transform_points(T_hand_link[link], centre[None])[0]
            best = np.minimum(best, np.linalg.norm(points - middle, axis=1) - radius)
    return best


def object_clearance(grasp: MergedGrasp, object0: PreparedObject, object1: PreparedObject) -> float:
    """Return the smallest signed distance between the two objects, m: surface points of each to the other."""
    T_0_1 = inverse_pose(grasp.T_hand_held0) @ grasp.T_hand_object1
    points1_in_0 = transform_points(T_0_1, object1.surface_points)
    points0_in_1 = transform_points(inverse_pose(T_0_1), object0.surface_points)
    return float(min(signed_distance(object0, points1_in_0).min(), signed_distance(object1, points0_in_1).min()))


def hand_object_clearance(
    q: NDArray[np.float64], links: NDArray[np.int64], item: PreparedObject, T_hand_object: NDArray[np.float64]
) -> float:
    """Return the smallest signed distance, m, between some links of the hand at ``q`` and an object.

    Surface points of the links to the object and surface points of the object to the links: edges of either are seen.
    """
    hand = load_hand()
    T_hand_link = link_poses(hand, q[None])
    sample_links, samples = hand_surface(HAND_POINTS)
    chosen = np.isin(sample_links, links)
    if not chosen.any():
        return FAR
    on_hand = points_on_links(T_hand_link, sample_links[chosen], samples[chosen])[0]
    in_object = signed_distance(item, transform_points(inverse_pose(T_hand_object), on_hand)).min()
    on_object = transform_points(T_hand_object, item.surface_points)
    return float(min(in_object, distance_to_links(hand, T_hand_link[0], links, on_object).min()))


def hand_clearance(grasp: MergedGrasp, object0: PreparedObject, object1: PreparedObject) -> float:
    """Return the smallest signed distance, m, of an object to links that do not hold it, the thumb's base included.

    The bases of the other fingers are left out where the palm holds: they lie in its plane. :func:`base_clearance`
    looks after them.
    """
    hand = load_hand()
    everything = np.arange(len(hand.link_names))
    bases = links_of(hand, PALM_SIDE_BASES)
    not_first = np.setdiff1d(everything, holding_links(hand, grasp.first.fingers))
    not_second = np.setdiff1d(everything, np.concatenate([holding_links(hand, grasp.second.fingers), bases]))
    return min(
        hand_object_clearance(grasp.held_q, not_first, object0, grasp.T_hand_held0),
        hand_object_clearance(grasp.held_q, not_second, object1, grasp.T_hand_object1),
    )


def base_clearance(grasp: MergedGrasp, object1: PreparedObject) -> float:
    """Return the smallest signed distance, m, of object 1 to the finger bases beside the palm."""
    bases = links_of(load_hand(), PALM_SIDE_BASES)
    return hand_object_clearance(grasp.held_q, bases, object1, grasp.T_hand_object1)


def self_clearance(q: NDArray[np.float64]) -> float:
    """Return the smallest signed distance, m, between the ring finger and the other fingers.

    The other pairs of links stand as in a validated grasp; only the ring finger has got new neighbours.
    """
    hand = load_hand()
    ring = links_of(hand, RING_LINKS)
    others = np.setdiff1d(np.arange(1, len(hand.link_names)), ring)
    T_hand_link = link_poses(hand, q[None])
    links, samples = hand_surface(HAND_POINTS)
    points = points_on_links(T_hand_link, links, samples)[0]
    return float(
        min(
            distance_to_links(hand, T_hand_link[0], others, points[np.isin(links, ring)]).min(),
            distance_to_links(hand, T_hand_link[0], ring, points[np.isin(links, others)]).min(),
        )
    )


def mount_height(grasp: MergedGrasp, object1: PreparedObject) -> float:
    """Return the height, m, of flange and mount over the plane that object 1 stands on, with the hand at its grasp."""
    points = transform_points(grasp.second.T_object_hand, mount_surface())
    return float(points[:, 2].min() - object1.bottom)


def support_height(
    q: NDArray[np.float64],
    T_object_hand: NDArray[np.float64],
    support: float,
    links: NDArray[np.int64] | None = None,
) -> float:
    """Return the height, m, of the lowest surface point of the hand at ``q`` over the plane z = ``support``.

    Args:
        T_object_hand: the hand in the frame of the object that stands on the plane.
        links: consider only these.
    """
    hand = load_hand()
    sample_links, samples = hand_surface(HAND_POINTS)
    chosen = np.ones(len(sample_links), bool) if links is None else np.isin(sample_links, links)
    points = points_on_links(link_poses(hand, q[None]), sample_links[chosen], samples[chosen])[0]
    return float(transform_points(T_object_hand, points)[:, 2].min() - support)


def held_object_height(grasp: MergedGrasp, object0: PreparedObject, object1: PreparedObject) -> float:
    """Return the height, m, of the held object 0 over the plane that object 1 stands on."""
    points = transform_points(grasp.second.T_object_hand @ grasp.T_hand_held0, object0.surface_points)
    return float(points[:, 2].min() - object1.bottom)
