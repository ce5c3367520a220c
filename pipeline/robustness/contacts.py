"""A grasp to be measured, and the contacts of one of its objects: where the hand touches it, and what moves there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.kinematics import link_poses, point_jacobian, points_on_links
from pipeline.hand.model import Hand
from pipeline.physics.holding import HeldObject
from pipeline.records.poses import inverse_pose, transform_points
from pipeline.shapes.distance_field import DistanceField


@dataclass(frozen=True)
class Grip:
    """One object of a grasp, and how the hand holds it."""

    held: HeldObject  # with its pose at the grasp
    fingers: tuple[str, ...]  # that hold it; the palm may be one
    contact_candidates: NDArray[np.int64]  # (n,) indices into Hand.contact_points


@dataclass(frozen=True)
class GraspInHand:
    """A hand about to squeeze its objects."""

    hand: Hand
    grips: tuple[Grip, ...]  # in the order of picking
    q: NDArray[np.float64]  # (J,) rad, joints of the grasp
    squeeze_q: NDArray[np.float64]  # (J,) rad, drive targets


@dataclass(frozen=True)
class GripContacts:
    """``n`` contacts of a hand of ``J`` joints with one object, in its frame, whose origin is its centre of mass."""

    points: NDArray[np.float64]  # (n, 3) m
    inward: NDArray[np.float64]  # (n, 3) unit normals into the object
    jacobians: NDArray[np.float64]  # (n, 3, J) m/rad, motion of each point with the joints; zero on the palm


def grip_contacts(grip: Grip, q: NDArray[np.float64], hand: Hand) -> GripContacts:
    """Return the contact points of a grip on the hand, and the object's normals there.

    Args:
        q: (J,) joint angles of the grasp, rad.
    """
    candidates, T_hand_object = grip.contact_candidates, grip.held.T_hand_object
    links = hand.contact_link[candidates]
    T_hand_link = link_poses(hand, q[None])
    in_hand = points_on_links(T_hand_link, links, hand.contact_points[candidates])[0]
    points = transform_points(inverse_pose(T_hand_object), in_hand)
    outward = DistanceField(grip.held.prepared).look_up(points)[1]
    inward = -outward / np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-9)
    moves = [point_jacobian(hand, T_hand_link[0], int(link), point) for link, point in zip(links, in_hand, strict=True)]
    return GripContacts(points, inward, T_hand_object[:3, :3].T @ np.stack(moves))
