"""How good samples are without physics: overlap, contact, and likeness to grasps that were kept from training."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.model import Hand
from pipeline.hand.surface import hand_surface
from pipeline.model.representation import GraspBatch
from pipeline.records.objects import PreparedObject
from pipeline.records.poses import inverse_pose, transform_points
from pipeline.shapes.distance_field import DistanceField

HAND_POINTS = 2000  # about 5 mm apart
OBJECT_POINTS = 1024
SHAPE_POINTS = 100  # of the hand, in the distance between grasps
COVERED = 0.015  # m; a held-out grasp with a sample nearer than this counts as covered


def penetration_depth(
    hand: Hand,
    prepared: PreparedObject,
    field: DistanceField,
    T_hand_object: NDArray[np.float64],
    q: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return how deep hand and object overlap at most (B,), m: points of either inside the other.

    Args:
        T_hand_object: (B, 4, 4).
        q: (B, J) rad.
    """
    T_hand_link = link_poses(hand, q)
    link, local = hand_surface(HAND_POINTS, hand)
    on_hand = transform_points(inverse_pose(T_hand_object), points_on_links(T_hand_link, link, local))
    deepest = np.maximum(-field.look_up(on_hand)[0].min(1), 0.0)
    on_object = transform_points(T_hand_object, prepared.surface_points[:OBJECT_POINTS])
    for box, pose, half in zip(hand.box_link, hand.box_pose, hand.box_half, strict=True):
        beyond = np.abs(transform_points(inverse_pose(T_hand_link[:, box] @ pose), on_object)) - half
        deepest = np.maximum(deepest, -beyond.max(-1).min(-1))
    for tip, centre, radius in zip(hand.sphere_link, hand.sphere_centre, hand.sphere_radius, strict=True):
        middle = transform_points(T_hand_link[:, tip], centre[None])
        deepest = np.maximum(deepest, radius - np.linalg.norm(on_object - middle, axis=-1).min(-1))
    return deepest


def grasp_distances(hand: Hand, first: GraspBatch, second: GraspBatch) -> NDArray[np.float64]:
    """Return distances (B, C), m, between grasps of one pair of objects.

    The distance is the mean, over both objects, of how far points of the hand are from their counterparts, seen from
    the object.
    """
    link, local = hand_surface(SHAPE_POINTS, hand)
    total = np.zeros((len(first), len(second)))
    for slot in (0, 1):
        shapes = []
        for grasps in (first, second):
            points = points_on_links(link_poses(hand, grasps.q), link, local)
            shapes.append(transform_points(inverse_pose(grasps.T_hand_object[:, slot]), points))
        for row, own in enumerate(shapes[0]):
            total[row] += np.linalg.norm(shapes[1] - own, axis=-1).mean(-1) / 2
    return total


def nearest_samples(hand: Hand, held_out: GraspBatch, samples: GraspBatch) -> dict[str, float]:
    """Return the share of held-out grasps that some sample is near to, and how far the nearest one is, median, mm."""
    nearest = grasp_distances(hand, held_out, samples).min(1)
    return {
        "grasps": len(nearest),
        "covered": float((nearest < COVERED).mean()),
        "nearest_mm_median": 1000 * float(np.median(nearest)),
    }
