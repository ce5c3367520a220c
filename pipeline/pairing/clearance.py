"""Static distances of a merged grasp: between the objects, and of hand and objects to what they must not touch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.allegro import FINGER_LINKS, Hand, load_hand
from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.parts import RING_LINKS
from pipeline.hand.surface import hand_surface, mount_surface
from pipeline.pairing.grasps import MergedGrasp
from pipeline.records.distance import signed_distance
from pipeline.records.objects import PreparedObject
from pipeline.records.poses import inverse_pose, transform_points

HAND_POINTS = 2000  # about 5 mm apart
PALM_SIDE_BASES = ("link_0.0", "link_4.0", "link_8.0")
FAR = 1.0  # m, the distance to nothing at all


@dataclass(frozen=True)
class PosedHand:
    """Links and surface points of the hand at one posture, in the hand frame."""

    T_hand_link: NDArray[np.float64]  # (L, 4, 4)
    sample_links: NDArray[np.int64]  # (n,)
    samples: NDArray[np.float64]  # (n, 3) m

    def points_on(self, links: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the surface points (m, 3) on some links."""
        return self.samples[np.isin(self.sample_links, links)]


def posed_hand(q: NDArray[np.float64]) -> PosedHand:
    """Return the hand at joint angles ``q`` (16,), rad."""
    T_hand_link = link_poses(load_hand(), q[None])
    links, samples = hand_surface(HAND_POINTS)
    return PosedHand(T_hand_link[0], links, points_on_links(T_hand_link, links, samples)[0])


def links_of(hand: Hand, names: Sequence[str]) -> NDArray[np.int64]:
    """Return link indices of some link names."""
    return np.array([hand.link(name) for name in names], dtype=np.int64)


def holding_links(hand: Hand, fingers: Sequence[str]) -> NDArray[np.int64]:
    """Return the links that may touch an object held by ``fingers``."""
    return links_of(hand, [link for finger in fingers for link in FINGER_LINKS[finger]])


def distance_to_links(
    T_hand_link: NDArray[np.float64], links: NDArray[np.int64], points: NDArray[np.float64], below: float = FAR
) -> float:
    """Return the smallest signed distance, m, of ``points`` (n, 3), hand frame, to the collision shapes of some links.

    Exact distance to boxes and balls, positive outside. Shapes and points are only looked at when their bounding balls
    could come nearer than what is known already.

    Args:
        T_hand_link: (L, 4, 4), one hand.
        below: m; returned when nothing is nearer.
    """
    hand = load_hand()
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


def object_clearance(grasp: MergedGrasp, object0: PreparedObject, object1: PreparedObject) -> float:
    """Return the smallest signed distance between the two objects, m: surface points of each to the other."""
    T_0_1 = inverse_pose(grasp.T_hand_held0) @ grasp.T_hand_object1
    points1_in_0 = transform_points(T_0_1, object1.surface_points)
    points0_in_1 = transform_points(inverse_pose(T_0_1), object0.surface_points)
    return float(min(signed_distance(object0, points1_in_0).min(), signed_distance(object1, points0_in_1).min()))


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
    return distance_to_links(posed.T_hand_link, links, transform_points(T_hand_object, item.surface_points), in_object)


def hand_clearance(grasp: MergedGrasp, posed: PosedHand, object0: PreparedObject, object1: PreparedObject) -> float:
    """Return the smallest signed distance, m, of an object to links that do not hold it, the thumb's base included.

    The bases of the other fingers are left out where the palm holds: they lie in its plane. :func:`base_clearance`
    looks after them.

    Args:
        posed: the hand at ``grasp.held_q``.
    """
    hand = load_hand()
    everything = np.arange(len(hand.link_names))
    bases = links_of(hand, PALM_SIDE_BASES)
    not_first = np.setdiff1d(everything, holding_links(hand, grasp.first.fingers))
    not_second = np.setdiff1d(everything, np.concatenate([holding_links(hand, grasp.second.fingers), bases]))
    return min(
        hand_object_clearance(posed, not_first, object0, grasp.T_hand_held0),
        hand_object_clearance(posed, not_second, object1, grasp.T_hand_object1),
    )


def base_clearance(grasp: MergedGrasp, posed: PosedHand, object1: PreparedObject) -> float:
    """Return the smallest signed distance, m, of object 1 to the finger bases beside the palm."""
    return hand_object_clearance(posed, links_of(load_hand(), PALM_SIDE_BASES), object1, grasp.T_hand_object1)


def self_clearance(posed: PosedHand) -> float:
    """Return the smallest signed distance, m, between the ring finger and the other fingers.

    The other pairs of links stand as in a validated grasp; only the ring finger has got new neighbours.
    """
    hand = load_hand()
    ring = links_of(hand, RING_LINKS)
    others = np.setdiff1d(np.arange(1, len(hand.link_names)), ring)
    to_others = distance_to_links(posed.T_hand_link, others, posed.points_on(ring))
    return distance_to_links(posed.T_hand_link, ring, posed.points_on(others), to_others)


def mount_height(grasp: MergedGrasp, object1: PreparedObject) -> float:
    """Return the height, m, of flange and mount over the plane that object 1 stands on, with the hand at its grasp."""
    points = transform_points(grasp.second.T_object_hand, mount_surface())
    return float(points[:, 2].min() - object1.bottom)


def support_height(
    posed: PosedHand, T_object_hand: NDArray[np.float64], support: float, links: NDArray[np.int64] | None = None
) -> float:
    """Return the height, m, of the lowest surface point of a hand over the plane z = ``support``.

    Args:
        T_object_hand: the hand in the frame of the object that stands on the plane.
        links: consider only these.
    """
    points = posed.samples if links is None else posed.points_on(links)
    return float(transform_points(T_object_hand, points)[:, 2].min() - support)


def held_object_height(grasp: MergedGrasp, object0: PreparedObject, object1: PreparedObject) -> float:
    """Return the height, m, of the held object 0 over the plane that object 1 stands on."""
    points = transform_points(grasp.second.T_object_hand @ grasp.T_hand_held0, object0.surface_points)
    return float(points[:, 2].min() - object1.bottom)
