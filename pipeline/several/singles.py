"""Grasps of each object of a sequence by itself, with the part of the hand that is given to it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.compute.fan_out import Workers
from pipeline.hand.moves import finger_joints, straight
from pipeline.hand.support import PLANE, Support
from pipeline.pairing.grasps import fingers_of
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters import Parameters
from pipeline.records.parameters.several import PickParameters, SeveralParameters
from pipeline.records.parameters.synthesize import StyleParameters
from pipeline.synthesize.candidates import Request, synthesize
from pipeline.validate.table import validate_table


def support_of(pick: PickParameters, perturbation: float) -> Support:
    """Return what the object stands on; a post is taken as wide as it may be beside the object's middle.

    Args:
        perturbation: m, how far the object may stand beside the middle of its post.
    """
    return PLANE if pick.post is None else Support(pick.post.width / 2 + perturbation, pick.post.height)


def style_of(pick: PickParameters, support: Support, base: StyleParameters) -> StyleParameters:
    """Return the settings of a style for one finger set; heights count from the plane that a post stands on."""
    key = "+".join(pick.fingers)
    changes = {
        "finger_sets": [list(pick.fingers)],
        "contacts": {key: len(pick.fingers)},
        "links": {},
        "chains": pick.chains,
        "table_clearance": base.table_clearance - support.height,
    }
    if base.mount_clearance is not None:
        changes["mount_clearance"] = base.mount_clearance - support.height
    return base.model_copy(update=changes)


def with_straight(q: NDArray[np.float64], fingers: Sequence[str]) -> NDArray[np.float64]:
    """Return joints (16,) with some fingers straight."""
    changed = np.array(q)
    changed[finger_joints(fingers)] = straight(fingers)
    return changed


def single_grasps(
    number: int, prepared: PreparedObject, sequence: SeveralParameters, parameters: Parameters, workers: Workers
) -> pd.DataFrame:
    """Return the table ``VALIDATED`` of the object of one pick."""
    pick = sequence.picks[number]
    waiting = fingers_of([later.fingers for later in sequence.picks[number + 1 :]])
    support = support_of(pick, parameters.evaluate.perturbation)
    request = Request(
        prepared=prepared,
        style=pick.style,
        run_seed=sequence.seed,
        energy=parameters.synthesize.energy,
        optimizer=parameters.synthesize.optimizer,
        settings=style_of(pick, support, getattr(parameters.synthesize, pick.style)),
        waiting=waiting,
    )
    candidates = synthesize(request, workers)
    # In the sequence these fingers are straight while this object is picked.
    candidates["q"] = [with_straight(q, waiting) for q in candidates["q"]]
    label = f"validate {pick.name}"
    return validate_table(candidates, prepared, parameters.physics, parameters.validate_, workers, label, support)
