"""Grasps of a file brought into our frames and joint order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.model import Hand
from pipeline.records.errors import UserError
from pipeline.records.ordinals import ORDINALS
from pipeline.records.parameters import Parameters
from pipeline.records.poses import inverse_pose
from pipeline.score.assignment import assign
from pipeline.score.foreign import ForeignFile
from pipeline.score.frames import Placed
from pipeline.score.joints import JointMap, within_limits
from pipeline.score.own_objects import ScoredObject
from pipeline.score.scoring import ReadyGrasp

FAR = np.pi  # rad beyond a limit, which no rounding and no other convention of zero explains


@dataclass(frozen=True)
class PlacedFile:
    """The grasps of a file around prepared objects."""

    file: ForeignFile
    joints: JointMap
    placed: tuple[tuple[Placed, ...], ...]  # per grasp, each of its objects
    squeeze_q: tuple[NDArray[np.float64] | None, ...]  # (J,) rad, drive targets of each grasp, where the file has them
    excess: tuple[float, ...]  # rad, how far joints of each grasp were beyond their limits
    T_prepared_mesh: NDArray[np.float64]  # (4, 4) of the first object


def place(
    file: ForeignFile,
    objects: Sequence[Callable[[float], ScoredObject]],
    hand: Hand,
    joints: JointMap,
    inverse: bool,
) -> PlacedFile:
    """Return the grasps around their objects.

    Args:
        objects: in the order of picking; each gives the object at a scale.
        inverse: the poses are those of the objects in the hand's frame.

    Raises:
        UserError: there are more or fewer objects than the grasps hold, or joints are far beyond their limits.
    """
    count = len(file.grasps[0].holds)
    if any(len(grasp.holds) != count for grasp in file.grasps):
        raise UserError(f"{file.source} has grasps of one object and of two; give one file for each.")
    if len(objects) != count:
        raise UserError(
            f"{file.source} has grasps of {count} object{'s' * (count > 1)}; give --object that many times."
        )
    placed, squeezes, excess = [], [], []
    for grasp in file.grasps:
        q, beyond = within_limits(grasp.joints[joints.columns], hand)
        if beyond > FAR:
            raise UserError(
                f"{file.source} has joints {beyond:.3g} rad beyond the limits of the hand {hand.name}, so they are in "
                "degrees, or of another hand; convert them to radians, or choose another --hand."
            )
        own = []
        for source, hold in zip(objects, grasp.holds, strict=True):
            scored = source(grasp.scale)
            T = inverse_pose(hold.T_object_hand) if inverse else hold.T_object_hand
            own.append(Placed(scored.prepared, scored.T_prepared_poses(file.y_up) @ T, q))
        placed.append(tuple(own))
        squeezes.append(None if grasp.squeeze is None else within_limits(grasp.squeeze[joints.columns], hand)[0])
        excess.append(beyond)
    T_prepared_mesh = objects[0](file.grasps[0].scale).T_prepared_mesh
    return PlacedFile(file, joints, tuple(placed), tuple(squeezes), tuple(excess), T_prepared_mesh)


def ready_grasps(read: PlacedFile, hand: Hand, parameters: Parameters) -> list[ReadyGrasp]:
    """Return the grasps with the fingers and contacts that are meant to hold.

    Args:
        parameters: of which `synthesize` and, for two objects, `picks` are used.

    Raises:
        UserError: the file names fingers or contacts that the hand does not have, or the hand has not the styles of
            the picks.
    """
    styles = [""] if len(read.placed[0]) == 1 else [pick.style for pick in parameters.picks]
    if len(styles) < len(read.placed[0]):
        raise UserError(f"params.yaml has no {ORDINALS[len(styles)]} pick; add it under `picks`.")
    for style in filter(None, styles):
        hand.style(style)
    found = []
    for grasp, placed, squeeze_q in zip(read.file.grasps, read.placed, read.squeeze_q, strict=True):
        assigned = tuple(
            assign(hand, one.prepared, one.T_object_hand, one.q, hold, parameters.synthesize, style)
            for one, hold, style in zip(placed, grasp.holds, styles, strict=False)
        )
        objects = tuple(one.prepared for one in placed)
        found.append(ReadyGrasp(objects, tuple(one.T_object_hand for one in placed), placed[0].q, squeeze_q, assigned))
    return found
