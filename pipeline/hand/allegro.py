"""The Allegro for pairing, plan, share and several, until they take the hand that they work with."""

from __future__ import annotations

import numpy as np

from pipeline.hand import model
from pipeline.hand.model import Hand as Hand
from pipeline.records.hands import ALLEGRO, description_file
from pipeline.records.parameters.hand import read_description

_DESCRIPTION = read_description(description_file(ALLEGRO))

JOINT_NAMES: tuple[str, ...] = tuple(_DESCRIPTION.joints)
FINGER_JOINTS: dict[str, tuple[int, ...]] = {
    name: tuple(JOINT_NAMES.index(joint) for joint in finger.joints) for name, finger in _DESCRIPTION.fingers.items()
}
FINGER_LINKS: dict[str, tuple[str, ...]] = {name: tuple(own.links) for name, own in _DESCRIPTION.fingers.items()}
RING_JOINTS = np.array(FINGER_JOINTS["ring"], dtype=np.int64)
RING_LINKS = (_DESCRIPTION.fingers["ring"].base, *FINGER_LINKS["ring"])
EXTENDED_FINGER = np.array(_DESCRIPTION.fingers["ring"].straight)  # rad, a straight finger
TIP_RADIUS = _DESCRIPTION.shapes[FINGER_LINKS["index"][-1]].spheres[0].radius  # m


def load_hand() -> Hand:
    """Return the Allegro.

    Raises:
        UserError: mani_skill is not installed.
    """
    return model.load_hand(ALLEGRO)
