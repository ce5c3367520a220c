"""Whether hands of a file touch their objects as its frames were understood, and how they would.

A grasp touches where two fingers or more (the palm counts) come near the object's surface and nothing is deep inside.
Where few do, the poses are read in other ways; one in which most touch is what the file probably means.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.model import Hand
from pipeline.hand.surface import hand_surface
from pipeline.records.objects import PreparedObject
from pipeline.records.poses import inverse_pose, transform_points
from pipeline.sample.contacts import TOUCHING
from pipeline.score.readers import BENCH_PALM
from pipeline.shapes.distance_field import DistanceField
from pipeline.shapes.frame import ROTATIONS

HAND_POINTS = 500  # sampled on the hand, to find what is inside the object
DEEP = 0.01  # m; a hand that reaches farther into an object is not in the frame that was meant
ENOUGH = 0.5  # of the grasps; where fewer touch, other readings are tried
BETTER = 0.3  # by which another reading must exceed the share, to be worth a hint
TRIED = 60  # grasps looked at in each reading
SYMMETRIC = 0.01  # rad; the range of a joint that spreads a finger is about as large to either side


@dataclass(frozen=True)
class Placed:
    """A hand at an object, both in our frames."""

    prepared: PreparedObject
    T_object_hand: NDArray[np.float64]  # (4, 4)
    q: NDArray[np.float64]  # (J,) rad


@dataclass(frozen=True)
class Touch:
    """How a hand touches an object."""

    nearest: dict[str, float]  # m, smallest distance of each finger's contact points to the surface
    deepest: float  # m, how deep a point of the hand is inside, 0 outside

    @property
    def fingers(self) -> tuple[str, ...]:
        """The fingers that are near, in the hand's order."""
        return tuple(finger for finger, distance in self.nearest.items() if distance <= TOUCHING)

    @property
    def holds(self) -> bool:
        """Whether this could be a grasp."""
        return len(self.fingers) >= 2 and self.deepest <= DEEP


def touch(
    hand: Hand, field: DistanceField, T_object_hand: NDArray[np.float64], q: NDArray[np.float64], y: int = 1
) -> Touch:
    """Return how a hand touches an object.

    Args:
        y: -1 for the mirror image of the hand.
    """
    T = link_poses(hand, q[None])
    mirror = np.array([1.0, y, 1.0])
    contacts = points_on_links(T, hand.contact_link, hand.contact_points)[0] * mirror
    distance = np.abs(field.look_up(transform_points(T_object_hand, contacts))[0])
    links, points = hand_surface(HAND_POINTS, hand)
    skin = points_on_links(T, links, points)[0] * mirror
    inside = field.look_up(transform_points(T_object_hand, skin))[0]
    own = np.array(hand.contact_finger)
    nearest = {finger: float(distance[own == finger].min()) for finger in hand.finger_links if (own == finger).any()}
    return Touch(nearest, float(np.maximum(-inside, 0).max()))


@dataclass(frozen=True)
class Reading:
    """Another way to read a file."""

    hint: str  # what would have to be done, for the user
    pose: Callable[[NDArray[np.float64]], NDArray[np.float64]] = lambda T: T
    joints: Callable[[NDArray[np.float64], Hand], NDArray[np.float64]] = lambda q, hand: q
    y: int = 1


def _moved(factor: float) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    def pose(T: NDArray[np.float64]) -> NDArray[np.float64]:
        T = T.copy()
        T[:3, 3] *= factor
        return T

    return pose


def _turned(axis: str) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    T_turned = np.eye(4)
    T_turned[:3, :3] = ROTATIONS[axis]
    return lambda T: T_turned @ T


def _transposed(T: NDArray[np.float64]) -> NDArray[np.float64]:
    T = T.copy()
    T[:3, :3] = T[:3, :3].T
    return T


def _moving_axes(T: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a pose with its angles about the fixed axes x, y, z taken as those about moving ones."""
    T = T.copy()
    T[:3, :3] = Rotation.from_euler("XYZ", Rotation.from_matrix(T[:3, :3]).as_euler("xyz")).as_matrix()
    return T


def _spread_reversed(q: NDArray[np.float64], hand: Hand) -> NDArray[np.float64]:
    """Return joints with those that spread fingers turned the other way, as in many descriptions of a left hand."""
    spreading = np.abs(hand.lower + hand.upper) < SYMMETRIC
    return np.where(spreading, -q, q)


AS_READ = Reading("")
LEFT = "the hand of the file is the mirror image of {hand}: describe a left hand under hands/, or mirror the grasps"
READINGS: tuple[Reading, ...] = (
    Reading(LEFT, y=-1),
    Reading(LEFT, joints=_spread_reversed, y=-1),
    Reading("poses are of the object in the hand's frame: add --inverse", inverse_pose),
    Reading(
        "rotations are those of the object in the hand's frame: transpose them, or conjugate quaternions", _transposed
    ),
    Reading("angles turn about moving axes x, y, z instead of fixed ones: convert them", _moving_axes),
    Reading("positions are in millimetres: divide them by 1000", _moved(0.001)),
    Reading("positions are in centimetres: divide them by 100", _moved(0.01)),
    Reading(
        "poses are of the root of DexGraspBench's MJCF: give them there, see docs/lab.md", lambda T: T @ BENCH_PALM
    ),
    Reading("poses are of the URDF's root link, not of DexGraspBench's MJCF", lambda T: T @ inverse_pose(BENCH_PALM)),
    *(
        Reading(f"poses are of a mesh whose {axis} axis is up where this one's +z is: turn the mesh", _turned(axis))
        for axis in ROTATIONS
        if axis != "+z"
    ),
)


@dataclass(frozen=True)
class FrameCheck:
    """What the contact test says of a file."""

    share: float  # of the grasps that touch their objects as the file was understood
    hint: str = ""  # what makes most of them touch; '' where that is not needed, or not known
    hinted_share: float = 0.0


def check_frames(
    hand: Hand,
    grasps: Sequence[Sequence[Placed]],
    others: Sequence[tuple[str, Callable[[], Sequence[Sequence[Placed]]]]],
    T_prepared_mesh: NDArray[np.float64],
) -> FrameCheck:
    """Return the share of grasps that touch all of their objects, and a hint where it is small.

    Args:
        grasps: per grasp, each of its objects.
        others: what the user would have to do, and what gives the same grasps as read then.
        T_prepared_mesh: (4, 4) frame of the mesh, in which other readings turn or invert poses, in that of the object.
    """
    fields: dict[int, DistanceField] = {}

    def share(reading: Reading, placed: Sequence[Sequence[Placed]] = grasps) -> float:
        return float(
            np.mean(
                [all(_holds(hand, each, reading, T_prepared_mesh, fields) for each in one) for one in placed[:TRIED]]
            )
        )

    found = share(AS_READ)
    if found >= ENOUGH:
        return FrameCheck(found)
    hints = [*(hint for hint, _ in others), *(reading.hint for reading in READINGS)]
    shares = [*(share(AS_READ, placed()) for _, placed in others), *map(share, READINGS)]
    best = int(np.argmax(shares))
    if shares[best] < found + BETTER:
        return FrameCheck(found)
    return FrameCheck(found, hints[best].format(hand=hand.name), shares[best])


def _holds(
    hand: Hand, placed: Placed, reading: Reading, T_prepared_mesh: NDArray[np.float64], fields: dict[int, DistanceField]
) -> bool:
    field = fields.setdefault(id(placed.prepared), DistanceField(placed.prepared))
    T_mesh_hand = inverse_pose(T_prepared_mesh) @ placed.T_object_hand
    T = T_prepared_mesh @ reading.pose(T_mesh_hand)
    return touch(hand, field, T, reading.joints(placed.q, hand), reading.y).holds
