"""What a robot needs besides hand and objects: how hard the fingers press, how they open, where the hand comes from.

A sample is split into a pinch grasp and a side grasp, as if both came from validation; from there on it goes the way of
any combination of two grasps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.approach import HandAtObject, choose_approach
from pipeline.hand.model import Hand
from pipeline.hand.moves import finger_joints, squeeze_joints, straight
from pipeline.model.held_out import STYLES
from pipeline.pairing.grasps import SingleGrasp
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.records.poses import inverse_pose
from pipeline.sample.contacts import Contacts


def single_grasps(
    hand: Hand,
    objects: tuple[PreparedObject, PreparedObject],
    T_hand_object: NDArray[np.float64],
    q: NDArray[np.float64],
    contacts: tuple[Contacts, Contacts],
    index: int,
    limits: ValidateParameters,
) -> tuple[SingleGrasp, SingleGrasp]:
    """Return the two halves of one sample.

    Args:
        T_hand_object: (2, 4, 4).
        q: (J,) rad.
        index: row of the sample in ``contacts``; becomes the ``grasp_id``.
    """
    halves = []
    for slot, style in enumerate(STYLES):
        own = contacts[slot]
        fingers, candidates = own.fingers[index], own.candidates[index]
        inward = -own.normals[index] @ T_hand_object[slot, :3, :3].T
        posture = q.copy()
        waiting = hand.style(style).waiting  # while the hand comes to object 0, nothing is in these fingers yet
        posture[finger_joints(waiting, hand)] = straight(waiting, hand)
        T_object_hand = inverse_pose(T_hand_object[slot])
        grasp = HandAtObject(hand, style, T_object_hand, posture, candidates)
        approach = choose_approach(grasp, objects[slot], limits.opening(style), [limits.approach_length])
        halves.append(
            SingleGrasp(
                grasp_id=index,
                fingers=fingers,
                T_object_hand=T_object_hand,
                contact_candidates=candidates,
                q=posture,
                squeeze_q=squeeze_joints(hand, posture, candidates, inward, limits.squeeze(style), list(fingers)),
                open_q=approach.open_q,
                approach_direction=approach.direction,
            )
        )
    return halves[0], halves[1]
