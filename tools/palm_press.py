"""Which finger can press an object against the palm, and in what posture; where a stretched finger is.

Guesses from random postures, for a description that a person then reads; see ``tools.describe_hand``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.model import Hand
from pipeline.hand.moves import finger_joints
from pipeline.hand.surface import farthest_points, hand_surface
from pipeline.records.parameters.hand import PALM
from tools.hand_guesses import Held, Meeting, distance_to_link, finger_bases, outward_normals, tip_points

POSTURES = 6000  # random ones
RADII = (0.035, 0.03, 0.025, 0.02)  # m, of upright cylinders against the palm, from the loosest grip to the tightest
NEEDED = 0.03  # m: which of them a finger must be able to press
LEAST_PRESS = 0.5  # cosine between the palm's normal and the way from the cylinder's axis to the tip
OVERLAP = 0.005  # m, that a finger may be inside the cylinder
SIDEWAYS = 0.015  # m, that a tip may be beside the palm
TURNED = 0.03  # m/rad2, of reach that a finger gives up rather than turn its joints away from the URDF's zero
FLAT = 0.9  # cosine, of what looks as the palm does
LEVEL = 0.006  # m, from the palm's height
LEAST_AREA = 12  # points of the palm that look so, of `SURFACE` on the hand
SURFACE = 4000
PALM_CONTACTS = 16
BESIDE = 0.4  # of the way from the fingers' bases to where they meet: with less across, fingers stand about the palm
FIRST, BENDS = 3, 3  # of a holding finger: angles of its first joint, rows of the others


@dataclass(frozen=True)
class PalmFace:
    """The flat of the palm, hand frame."""

    normal: NDArray[np.float64]  # (3,) unit
    along: NDArray[np.float64] | None  # (3,) unit, the way that stretched fingers point; None: as the palm faces
    points: NDArray[np.float64]  # (n, 3) m, of its surface

    @property
    def height(self) -> float:
        """Its distance from the hand's origin, along the normal."""
        return float(np.median(self.points @ self.normal))


@dataclass(frozen=True)
class Press:
    """How a finger presses upright cylinders against the palm."""

    finger: str
    posture: NDArray[np.float64]  # (j,) rad, of the finger's joints, on a cylinder of radius ``NEEDED``
    held: Held  # that cylinder
    first: list[float]  # rad, angles of its first joint on all cylinders
    bent: list[list[float]]  # rad, of the others, from the widest cylinder to the thinnest


def sampled(hand: Hand) -> NDArray[np.float64]:
    """Return random postures (n, J), rad."""
    rng = np.random.Generator(np.random.PCG64(2))
    return rng.uniform(hand.lower, hand.upper, (POSTURES, hand.joint_count))


@dataclass(frozen=True)
class Stretched:
    """A finger far out."""

    angles: NDArray[np.float64]  # (j,) rad, of its joints
    base: NDArray[np.float64]  # (3,) m, where its first link is, hand frame
    way: NDArray[np.float64]  # (3,) unit, from there to its tip


def stretched(hand: Hand, q: NDArray[np.float64]) -> dict[str, Stretched]:
    """Return every finger with its tip far from its first link, and little turned.

    Args:
        q: (n, J) postures to choose from; the URDF's zero is another.
    """
    q = np.concatenate([np.clip(np.zeros((1, hand.joint_count)), hand.lower, hand.upper), q])
    T = link_poses(hand, q)
    found = {}
    for finger, (link, point) in tip_points(hand).items():
        joints = finger_joints([finger], hand)
        base = T[:, hand.link(hand.finger_links[finger][0]), :3, 3]
        tip = points_on_links(T, np.array([link]), point[None])[:, 0]
        turned = (q[:, joints] ** 2).sum(1)
        row = (np.linalg.norm(tip - base, axis=1) - TURNED * turned).argmax()
        way = tip[row] - base[row]
        found[finger] = Stretched(q[row, joints], base[row], way / max(np.linalg.norm(way), 1e-9))
    return found


def facing(hand: Hand, found: Meeting, straight: Mapping[str, Stretched], opposing: Sequence[str]) -> PalmFace:
    """Return which way the palm faces: to where the fingertips meet, across the stretched fingers.

    Where the fingers stand about the palm and point the same way as it faces, the way to where they meet alone.
    """
    fingers = [own for finger, own in straight.items() if finger not in opposing]
    towards = found.centre - np.mean([own.base for own in fingers], axis=0)
    along = np.mean([own.way for own in fingers], axis=0)
    along /= max(np.linalg.norm(along), 1e-9)
    across = towards - (towards @ along) * along
    about = np.linalg.norm(across) < BESIDE * np.linalg.norm(towards)
    normal = found.centre if about else across
    flats = list(_flat(hand, normal / np.linalg.norm(normal)))
    points = np.concatenate([np.zeros((0, 3)), *(own @ T[:3, :3].T + T[:3, 3] for _, own, _, T in flats)])
    if len(points):
        normal = np.concatenate([own @ T[:3, :3].T for _, _, own, T in flats]).mean(0)
    normal = normal / np.linalg.norm(normal)
    return PalmFace(normal, None if about else along, points)


def _flat(
    hand: Hand, normal: NDArray[np.float64]
) -> Iterator[tuple[str, NDArray[np.float64], NDArray[np.float64], Any]]:
    """Yield what of each link of the palm looks about along a direction: points, their normals (n, 3), link frame.

    With each its link, and that link's pose T_hand_link (4, 4).
    """
    owner, local = hand_surface(SURFACE, hand)
    T_hand_link = link_poses(hand, ((hand.lower + hand.upper) / 2)[None])[0]
    for name in hand.finger_links.get(PALM, ()):
        link = hand.link(name)
        points = local[owner == link]
        if len(points):
            normals = outward_normals(hand, link, points)
            chosen = normals @ T_hand_link[link, :3, :3].T @ normal > FLAT
            chosen &= np.abs(distance_to_link(hand, link, points)) < 1e-6
            yield name, points[chosen], normals[chosen], T_hand_link[link]


def palm_contacts(hand: Hand, face: PalmFace) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return contact candidates of the palm by link, points and normals (n, 3), link frames."""
    contacts = {}
    for name, points, normals, T in _flat(hand, face.normal):
        height = (points @ T[:3, :3].T + T[:3, 3]) @ face.normal
        chosen = np.flatnonzero(np.abs(height - face.height) < LEVEL)
        if len(chosen):
            chosen = chosen[farthest_points(points[chosen], min(len(chosen), PALM_CONTACTS))]
            contacts[name] = points[chosen], normals[chosen]
    return contacts


def presses(hand: Hand, face: PalmFace, q: NDArray[np.float64]) -> dict[str, Press]:
    """Return, for every finger that can, how it presses upright cylinders against the palm.

    Args:
        q: (n, J) postures to choose from.
    """
    if face.along is None or len(face.points) < LEAST_AREA:
        return {}
    found, T = {}, link_poses(hand, q)
    for finger in tip_points(hand):
        joints, by_radius, rows_of, middles = finger_joints([finger], hand), {}, {}, {}
        for radius in RADII:
            best, axes = _pressing(hand, finger, face, face.along, radius, q, T)
            if len(best):
                by_radius[radius] = q[np.ix_(best, joints)]
                rows_of[radius], middles[radius] = q[best[0]], axes[0]
        if NEEDED not in by_radius or not len(joints):
            continue
        rows = np.concatenate(list(by_radius.values()))
        first = np.quantile(rows[:, 0], np.linspace(0.1, 0.9, FIRST)).tolist()
        bent = [own[0, 1:].tolist() for own in by_radius.values()][:BENDS]
        bent += [bent[-1]] * (2 - len(bent))
        held = Held(rows_of[NEEDED], middles[NEEDED], NEEDED, np.cross(face.along, face.normal))
        found[finger] = Press(finger, by_radius[NEEDED][0], held, first, bent)
    return found


def _pressing(
    hand: Hand,
    finger: str,
    face: PalmFace,
    fingers: NDArray[np.float64],
    radius: float,
    q: NDArray[np.float64],
    T: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the rows (m,) of q (n, J) in which a finger presses a cylinder against the palm, the best first.

    With the middle (m, 3) of each cylinder, hand frame.

    The cylinder's axis is across palm and fingers; where along the fingers it lies follows from the tip, which touches
    it.

    Args:
        fingers: (3,) unit, the way that they point, hand frame.
        T: (n, L, 4, 4) T_hand_link at q.
    """
    owner, local = hand_surface(SURFACE, hand)
    link = hand.link(hand.finger_links[finger][-1])
    middle = local[owner == link].mean(0)
    reach = radius + np.linalg.norm(local[owner == link] - middle, axis=1).mean()  # from the axis to the tip's middle
    tip = points_on_links(T, np.array([link]), middle[None])[:, 0]
    over, along = tip @ face.normal - face.height - radius, tip @ fingers
    axis = along - np.sqrt(np.maximum(reach**2 - over**2, 0.0))
    low, high = (face.points @ fingers).min(), (face.points @ fingers).max()
    across = np.cross(fingers, face.normal)
    side, own_side = face.points @ across, tip @ across
    beside = np.maximum(side.min() - own_side, own_side - side.max())
    press = over / reach
    can = (np.abs(over) <= reach) & (press > LEAST_PRESS) & (low <= axis) & (axis <= high) & (beside < SIDEWAYS)
    joints = finger_joints([finger], hand)
    bent = ((2 * (q - hand.lower) / (hand.upper - hand.lower) - 1) ** 2)[:, joints].mean(1)
    order = np.flatnonzero(can)
    order = order[np.argsort(bent[order] - press[order], kind="stable")]
    own = np.isin(owner, [hand.link(name) for name in hand.finger_links[finger]])
    kept, middles = [], []
    for row in order[:400]:
        points = points_on_links(T[row : row + 1], owner[own], local[own])[0]
        away = np.hypot(points @ face.normal - face.height - radius, points @ fingers - axis[row])
        if away.min() > radius - OVERLAP:
            kept.append(row)
            height = face.height + radius
            middles.append(height * face.normal + axis[row] * fingers + own_side[row] * across)
    return np.array(kept, np.int64), np.array(middles).reshape(-1, 3)


def presser(hand: Hand, found: Mapping[str, Press], opposing: Sequence[str]) -> str | None:
    """Return the finger that presses while others pinch: of those that can, the farthest from what they oppose.

    None where too few fingers would be left to pinch with.
    """
    able = [finger for finger in found if finger not in opposing]
    if not able or len(tip_points(hand)) < 3:
        return None
    bases = finger_bases(hand)
    others = [bases[finger] for finger in opposing if finger != PALM] or list(bases.values())
    return max(able, key=lambda finger: float(np.linalg.norm(bases[finger] - np.mean(others, axis=0))))
