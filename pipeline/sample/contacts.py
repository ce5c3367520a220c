"""Which points of the hand are meant to touch, when a sample only says where hand and objects are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.energy.arrays import torque_scale
from pipeline.energy.contacts import contact_shares, contact_slots, force_closure
from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.model import Hand
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.synthesize import EnergyParameters, StyleParameters
from pipeline.records.poses import transform_points
from pipeline.shapes.distance_field import DistanceField

TOUCHING = 0.006  # m; a finger that is farther from the object is not meant to hold it
SPREAD = 0.003  # m; candidates about this much farther than the nearest one are tried, too
TRIES = 64  # contact sets looked at per grasp


@dataclass(frozen=True)
class Contacts:
    """Assigned contacts of ``B`` grasps of one object."""

    fingers: list[tuple[str, ...]]  # (B,)
    candidates: list[NDArray[np.int64]]  # (B,) of (n,) indices into Hand.contact_points
    normals: list[NDArray[np.float64]]  # (B,) of (n, 3) outward from the object, object frame
    distance: NDArray[np.float64]  # (B,) mean distance of the contacts to the surface, m

    def chosen(self, index: NDArray[np.int64]) -> Contacts:
        """Return those of some of the grasps, in the given order."""
        return Contacts(
            [self.fingers[i] for i in index],
            [self.candidates[i] for i in index],
            [self.normals[i] for i in index],
            self.distance[index],
        )


def choose_fingers(nearest: dict[str, NDArray[np.float64]], sets: list[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Return the finger set (B,) of every grasp: the largest whose fingers all touch, else the nearest.

    Args:
        nearest: smallest distance (B,) of each finger's candidates to the object, m.
        sets: finger sets of the style.
    """
    farthest = np.stack([np.max([nearest[finger] for finger in fingers], axis=0) for fingers in sets], axis=1)
    size = np.array([len(fingers) for fingers in sets])
    order = np.where(farthest <= TOUCHING, -size * 1.0, farthest)  # any that touches before any that does not
    return [sets[index] for index in np.lexsort((farthest.T, order.T), axis=0)[0]]


def choose_contacts(
    hand: Hand,
    prepared: PreparedObject,
    field: DistanceField,
    T_object_hand: NDArray[np.float64],
    q: NDArray[np.float64],
    energy: EnergyParameters,
    style: StyleParameters,
    rng: np.random.Generator,
) -> Contacts:
    """Choose fingers and contact candidates of grasps: near the surface, and with forces that balance.

    Of some random sets, the nearer the likelier, the one of least weighted distance and force closure is taken.

    Args:
        T_object_hand: (B, 4, 4).
        q: (B, J) rad.
    """
    points = transform_points(
        T_object_hand, points_on_links(link_poses(hand, q), hand.contact_link, hand.contact_points)
    )
    distance, gradient = field.look_up(points)
    distance = np.abs(distance)
    normals = gradient / np.maximum(np.linalg.norm(gradient, axis=-1, keepdims=True), 1e-9)
    sets: list[tuple[str, ...]] = [tuple(fingers) for fingers in style.finger_sets]
    keys = ["+".join(fingers) for fingers in sets]
    own = np.array(hand.contact_finger)
    used = sorted({finger for fingers in sets for finger in fingers})
    nearest: dict[str, NDArray[np.float64]] = {name: distance[:, own == name].min(1) for name in used}
    fingers = choose_fingers(nearest, sets)
    scale = torque_scale(prepared.extents, energy.scale_torque)
    found: list[tuple[NDArray[np.int64], NDArray[np.float64], float]] = []
    for index, chosen in enumerate(fingers):
        key = keys[sets.index(chosen)]
        slots = contact_slots(hand, chosen, style.contacts[key], style.links.get(key, ()))
        picks = []
        for slot in slots:
            allowed = np.flatnonzero(slot)
            weight = slot[allowed] * np.exp(-(distance[index, allowed] - distance[index, allowed].min()) / SPREAD)
            picks.append(rng.choice(allowed, TRIES, p=weight / weight.sum()))
        tried = np.stack(picks, axis=1)
        tried[0] = [np.flatnonzero(slot)[distance[index, np.flatnonzero(slot)].argmin()] for slot in slots]
        repeated = np.array([len(set(row)) < len(row) for row in tried.tolist()])
        shares = contact_shares(hand, tried, energy.balance_forces)
        closure = force_closure(points[index, tried], normals[index, tried], shares, scale)
        cost = energy.weight_force_closure * closure + energy.weight_distance * distance[index, tried].sum(1)
        best = tried[np.where(repeated, np.inf, cost).argmin()]
        found.append((best, normals[index, best], float(distance[index, best].mean())))
    candidates, chosen_normals, mean = zip(*found, strict=True) if found else ((), (), ())
    return Contacts(fingers, list(candidates), list(chosen_normals), np.array(mean))
