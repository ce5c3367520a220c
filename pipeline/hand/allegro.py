"""The right Allegro hand (``hands/allegro``), for everything that is about this hand alone.

Two objects in one hand, the arm, the trials and the learned model know no other. What single-object grasps need works
with any described hand, ``hand.model``.
"""

from __future__ import annotations

import numpy as np

from pipeline.hand import model
from pipeline.hand.model import Hand as Hand
from pipeline.hand.urdf import origin_matrix as origin_matrix
from pipeline.records.parameters.hand import ALLEGRO, description_file, read_description

_DESCRIPTION = read_description(description_file(ALLEGRO))

JOINT_NAMES: tuple[str, ...] = tuple(_DESCRIPTION.joints)
FINGER_JOINTS: dict[str, tuple[int, ...]] = {
    name: tuple(JOINT_NAMES.index(joint) for joint in finger.joints) for name, finger in _DESCRIPTION.fingers.items()
}
FINGER_LINKS: dict[str, tuple[str, ...]] = {name: tuple(own.links) for name, own in _DESCRIPTION.fingers.items()}
FINGER_BASES: dict[str, str | None] = {name: own.base for name, own in _DESCRIPTION.fingers.items()}
RING_JOINTS = np.array(FINGER_JOINTS["ring"], dtype=np.int64)
RING_LINKS = (FINGER_BASES["ring"], *FINGER_LINKS["ring"])
EXTENDED_FINGER = np.array(_DESCRIPTION.fingers["ring"].straight)  # rad, a straight finger
TIP_RADIUS = _DESCRIPTION.shapes[FINGER_LINKS["index"][-1]].spheres[0].radius  # m


def load_hand() -> Hand:
    """Return the Allegro.

    Raises:
        UserError: mani_skill is not installed.
    """
    return model.load_hand(ALLEGRO)
