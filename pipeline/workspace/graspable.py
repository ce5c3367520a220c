"""Which widths the hand can hold: from the hand's own contact candidates, joint limits and moves.

A finger and its opponent (thumb against index or middle; ring against the palm) hold an object between two contact
candidates that face each other. The distance of the two, over all joint angles, is the width of the object.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pipeline.hand.allegro import Hand
    from pipeline.records.objects import PreparedObject
    from pipeline.records.parameters import Parameters

FACING = np.radians(15.0)  # between a contact's normal and the line to the other contact
OPPONENTS = {"pinch": (("thumb", "index"), ("thumb", "middle")), "side": (("ring", "palm"),)}
POSTURES = 20000  # per finger
PAIRS = 4_000_000  # of contacts


@dataclass(frozen=True)
class Widths:
    """Smallest and largest width, m."""

    smallest: float
    largest: float


def caliper_width(vertices: NDArray[np.float64]) -> float:
    """Return the smallest horizontal width (m) of a shape (V, 3): the gap of two upright parallel plates around it."""
    from scipy.spatial import ConvexHull

    corners = vertices[ConvexHull(vertices[:, :2]).vertices, :2]
    edges = np.roll(corners, -1, axis=0) - corners
    length = np.linalg.norm(edges, axis=1)
    edges = edges[length > 0] / length[length > 0, None]
    # The smallest width of a convex polygon is across one of its edges.
    across = corners @ np.stack([-edges[:, 1], edges[:, 0]])
    return float(np.ptp(across, axis=0).min())


def _contacts(
    hand: Hand, finger: str, generator: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return points and outward normals (n, 3), hand frame, of a finger's candidates in random postures."""
    from pipeline.hand.allegro import FINGER_JOINTS
    from pipeline.hand.kinematics import link_poses

    joints = list(FINGER_JOINTS[finger])
    q = np.zeros((POSTURES if joints else 1, 16))
    q[:, joints] = generator.uniform(hand.lower[joints], hand.upper[joints], (len(q), len(joints)))
    own = np.array([index for index, name in enumerate(hand.contact_finger) if name == finger])
    T = link_poses(hand, q)[:, hand.contact_link[own]]
    points = np.einsum("bnij,nj->bni", T[..., :3, :3], hand.contact_points[own]) + T[..., :3, 3]
    normals = np.einsum("bnij,nj->bni", T[..., :3, :3], hand.contact_normals[own])
    return points.reshape(-1, 3), normals.reshape(-1, 3)


@lru_cache(maxsize=2)
def widths(style: str) -> Widths:
    """Return the widths between facing contacts of a style's opponents; a fixed random draw of their joint angles."""
    from pipeline.hand.allegro import load_hand

    hand, generator = load_hand(), np.random.Generator(np.random.PCG64(0))
    found = []
    for finger, opponent in OPPONENTS[style]:
        (a, normal_a), (b, normal_b) = (_contacts(hand, one, generator) for one in (finger, opponent))
        for _ in range(PAIRS // 400_000):
            i, j = (generator.integers(len(points), size=400_000) for points in (a, b))
            line = b[j] - a[i]
            length = np.linalg.norm(line, axis=1)
            least = np.cos(FACING) * length
            facing = ((normal_a[i] * line).sum(axis=1) > least) & (-(normal_b[j] * line).sum(axis=1) > least)
            found.append(length[facing])
    gaps = np.concatenate(found)
    return Widths(float(gaps.min()), float(gaps.max()))


def verdict(style: str, prepared: PreparedObject, parameters: Parameters) -> str:
    """Return whether the width of an object fits a style, in words."""
    width, limits = caliper_width(prepared.vertices), widths(style)
    return f"{1000 * width:.1f} mm wide ({1000 * limits.smallest:.0f} to {1000 * limits.largest:.0f} mm fit)"
