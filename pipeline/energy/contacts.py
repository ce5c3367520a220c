"""Contacts of a grasp: where candidates lie, what forces they share, and which of them may be drawn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.energy.scene import Grasps
from pipeline.hand.kinematics import link_poses
from pipeline.hand.model import Hand
from pipeline.records.errors import UserError
from pipeline.records.parameters.hand import PALM

PALM_WEIGHT = 3.0  # chance of the palm in a contact draw, relative to one link of a finger (released code)


def contact_positions(hand: Hand, grasps: Grasps) -> NDArray[np.float64]:
    """Return contact points (B, n, 3) on the hand, object frame."""
    T = link_poses(hand, grasps.q)
    rows = np.arange(len(grasps))[:, None]
    own = T[rows, hand.contact_link[grasps.contacts]]
    in_hand = np.einsum("bnij,bnj->bni", own[..., :3, :3], hand.contact_points[grasps.contacts]) + own[..., :3, 3]
    R = Rotation.from_quat(grasps.rotation, scalar_first=True).as_matrix()
    return np.einsum("bij,bnj->bni", R, in_hand) + grasps.position[:, None]


def contact_shares(hand: Hand, contacts: NDArray[np.int64], balance: bool) -> NDArray[np.float64]:
    """Return the force share (B, n) of contacts (B, n): both opposing groups carry half, or 1 each as published."""
    opposing = np.array([finger in hand.opposing for finger in hand.contact_finger])[contacts]
    count = contacts.shape[1]
    mine = np.where(opposing, opposing.sum(1, keepdims=True), (~opposing).sum(1, keepdims=True))
    both = opposing.any(1, keepdims=True) & (~opposing).any(1, keepdims=True)
    return np.where(both, 0.5 * count / mine, 1.0) if balance else np.ones(contacts.shape)


def force_closure(
    points: NDArray[np.float64], normals: NDArray[np.float64], shares: NDArray[np.float64], scale: float
) -> NDArray[np.float64]:
    """Return |sum of share (n; scale x cross n)|^2 (B,) of contacts (B, n, 3): differentiable force closure.

    Source: the published energy, with a share per contact and torques scaled by the object's size.
    """
    forces = shares[..., None] * normals
    wrench = np.concatenate([forces.sum(1), scale * np.cross(points, forces).sum(1)], axis=-1)
    return (wrench**2).sum(-1)


def contact_slots(
    hand: Hand, fingers: Sequence[str], count: int, links: Sequence[str] = (), free: bool = False
) -> list[NDArray[np.float64]]:
    """Return, per contact, the chance (C,) of every candidate.

    The first contacts belong to one finger of the set each, so that every finger has one; further contacts are drawn
    from all fingers of the set. Links have equal chances, the palm three times that (released code).

    Args:
        count: number of contacts, at least one per finger.
        links: names of the links that may touch, all of the fingers' when empty.
        free: draw every contact from all fingers, as the released code does.

    Raises:
        UserError: a link is not of these fingers, or a finger has no link with contact candidates.
    """
    key = "+".join(fingers)
    unknown = sorted(set(links) - {link for finger in fingers for link in hand.finger_links[finger]})
    if unknown:
        raise UserError(
            f"params.yaml: links of {key} names {unknown[0]!r}, which is no link of these fingers; remove it there."
        )
    weights = np.zeros(len(hand.contact_link))
    for finger in fingers:
        touching = [link for link in hand.finger_links[finger] if link in links or not links]
        for own in (hand.contact_link == hand.link(link) for link in touching):
            if own.any():
                weights[own] = (PALM_WEIGHT if finger == PALM else 1.0) / own.sum()
        if not weights[np.array(hand.contact_finger) == finger].any():
            raise UserError(f"params.yaml: links of {key} leaves the {finger} no contact; name one of its links there.")
    slots = []
    for slot in range(count):
        own = weights.copy()
        if slot < len(fingers) and not free:
            own[np.array(hand.contact_finger) != fingers[slot]] = 0.0
        slots.append(own / own.sum())
    return slots
