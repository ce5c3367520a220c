"""What a grasp could bear at best: the largest weight and pushes by linear programs, and the least friction.

Contacts push with friction, also against turning about their normal; the hand's joints bear limited torque. A margin
is the largest load for which *some* contact forces balance it within these limits. It is an upper bound on what the
hand bears: position drives squeeze as commanded and do not choose the forces that a load asks for, and contacts
may lie elsewhere than planned. In one way it is too strict: an object that may swing into a position where it is held
counts as lost.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp, nnls
from scipy.sparse import block_diag, csc_array

from pipeline.physics.engine import GRAVITY
from pipeline.robustness.contacts import GripContacts

AXES = np.concatenate([np.eye(3), -np.eye(3)])  # (6, 3)
CORNERS = np.array(list(product((-1.0, 1.0), repeat=3))) / np.sqrt(3)  # (8, 3)
AROUND = 8  # directions of sliding in the tangent plane
MOST_LOAD = 1000.0  # N or N m: more is cut off; the palm alone bears any load towards it
MOST_FRICTION = 2.0
FRICTION_STEP = 0.01
UNBALANCED = 1e-6  # of a load: what may remain of it where it counts as balanced


@dataclass(frozen=True)
class Margins:
    """What one object's grip could bear at best; see the module for what is left out of account."""

    mass_factor: float  # multiple of the object's weight, in the worst of six directions of gravity
    push_force: float  # N at the centre of mass, without weight, in the worst of 14 directions
    push_torque: float  # N m, without weight, in the worst of six directions
    lowest_friction: float  # at which the weight can be held in all six; infinite above MOST_FRICTION


@dataclass(frozen=True)
class JointLimits:
    """What limits the forces at the contacts besides friction."""

    torque: float | NDArray[np.float64]  # N m, of every joint, or (J,) of each; N of joints that slide
    torsion_radius: float  # m; a contact of normal force N bears a moment of friction x N x this about its normal


def slides() -> NDArray[np.float64]:
    """Return the corners (18, 3) of what friction bears at a contact of unit normal force and unit friction.

    Sliding along two tangents and turning about the normal share one limit, a ball once turning is scaled (the
    ellipsoid of Howe and Cutkosky, 1996). Its place is taken by the hull of points on it: eight around, four at 45
    degrees to either side, and the two of pure turning. At most 8 % are lost in sliding alone, 19 % where both come
    together, none in turning alone.
    """
    around = 2 * np.pi * np.arange(AROUND) / AROUND
    ring = np.stack([np.cos(around), np.sin(around), 0 * around], axis=1)
    half = np.sqrt(0.5)
    sides = [np.stack([half * ring[::2, 0], half * ring[::2, 1], np.full(4, sign * half)], axis=1) for sign in (1, -1)]
    return np.concatenate([ring, *sides, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])


def margins(contacts: GripContacts, mass: float, friction: float, limits: JointLimits) -> Margins:
    """Return the margins of one object's grip.

    Args:
        mass: of the object, kg.
        friction: of all contacts, for all margins but ``lowest_friction``.
    """
    weight = mass * GRAVITY
    pushes = np.concatenate([AXES, CORNERS])
    loads = np.zeros((len(pushes) + len(AXES), 6))
    loads[: len(pushes), :3] = pushes
    loads[len(pushes) :, 3:] = AXES
    borne = largest_loads(contacts, loads, friction, limits)
    return Margins(
        mass_factor=float(borne[: len(AXES)].min() / weight),
        push_force=float(borne[: len(pushes)].min()),
        push_torque=float(borne[len(pushes) :].min()),
        lowest_friction=lowest_friction(contacts, weight, limits),
    )


def largest_loads(
    contacts: GripContacts, loads: NDArray[np.float64], friction: float, limits: JointLimits
) -> NDArray[np.float64]:
    """Return the largest multiples (m,), at most ``MOST_LOAD``, of loads that the contacts can balance.

    Args:
        loads: (m, 6) force, N, and moment about the centre of mass, N m, on the object; its frame.
    """
    columns, length = _columns(contacts, friction, limits)
    rows, corners = columns.shape
    scaled = loads / np.repeat([1.0, length], 3)
    blocks = [np.hstack([columns, np.append(load, np.zeros(rows - 6))[:, None]]) for load in scaled]
    most = np.tile(np.append(np.zeros(6), np.ones(rows - 6)), len(loads))
    upper = np.tile(np.append(np.full(corners, np.inf), MOST_LOAD), len(loads))
    wanted = np.tile(np.append(np.zeros(corners), -1.0), len(loads))
    balance = LinearConstraint(csc_array(block_diag(blocks)), -most, most)
    found = milp(wanted, constraints=balance, bounds=Bounds(0.0, upper))
    if found.x is None:  # never: bearing nothing is possible, and loads are bounded
        raise RuntimeError(f"a linear program of a grasp was not solved: {found.message}")
    return np.maximum(found.x[corners :: corners + 1], 0.0)


def lowest_friction(contacts: GripContacts, weight: float, limits: JointLimits) -> float:
    """Return the least friction, rounded up to ``FRICTION_STEP``, at which ``weight``, N, is held in six directions.

    More friction never harms here, so the steps are bisected.
    """

    def holds(step: int) -> bool:
        columns, _ = _columns(contacts, step * FRICTION_STEP, limits)
        return all(_balances(columns, weight * axis) for axis in AXES)

    fails, enough = 0, round(MOST_FRICTION / FRICTION_STEP)
    if not holds(enough):
        return np.inf
    while enough - fails > 1:
        middle = (fails + enough) // 2
        if holds(middle):
            enough = middle
        else:
            fails = middle
    return enough * FRICTION_STEP


def _columns(
    contacts: GripContacts, friction: float, limits: JointLimits
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what a unit normal force at each corner of each friction cone does, a column each, and a length, m.

    The first six rows are the wrench on the object, moments divided by that length, which makes them like forces; the
    others the torque of the joints that move a contact, as a share of its limit.
    """
    corners = friction * slides()
    tangents = np.stack([_tangents(normal) for normal in contacts.inward])  # (n, 2, 3)
    push = contacts.inward[:, None] + np.einsum("kj,njc->nkc", corners[:, :2], tangents)
    moment = np.cross(contacts.points[:, None], push)
    moment += limits.torsion_radius * corners[None, :, 2:] * contacts.inward[:, None]
    length = np.linalg.norm(contacts.points, axis=1).mean()
    moved = np.abs(contacts.jacobians).max((0, 1)) > 0
    torque = np.einsum("nkc,ncj->nkj", push, contacts.jacobians[..., moved])
    torque /= np.broadcast_to(limits.torque, moved.shape)[moved]
    whole = np.concatenate([push, moment / length, torque], axis=2)
    return np.ascontiguousarray(whole.reshape(-1, whole.shape[2]).T), length


def _tangents(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return two unit vectors (2, 3), at right angles to ``normal`` (3,) and to each other."""
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first)])


def _balances(columns: NDArray[np.float64], force: NDArray[np.float64]) -> bool:
    """Whether the contacts can balance a force (3,) at the centre of mass: a sum of columns within the torque limits.

    Non-negative least squares with slack for the limits: here three times as fast as a linear program.
    """
    wrench, torque = columns[:6], columns[6:]
    joints, load = len(torque), float(np.linalg.norm(force))
    free, slack = np.zeros((joints, joints)), np.eye(joints)
    system = np.block(
        [[wrench / load, np.zeros((6, 2 * joints))], [torque, slack, free], [-torque, free, slack]],
    )
    wanted = np.concatenate([-force / load, np.zeros(3), np.ones(2 * joints)])
    return bool(nnls(system, wanted)[1] < UNBALANCED)
