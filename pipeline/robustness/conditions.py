"""The conditions under which grasps are tried: drawn once for an object or a pair, the same for all of its grasps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.records.parameters.robustness import RobustnessParameters
from pipeline.robustness.disturbance import Disturbance, Vectors, draw_disturbance
from pipeline.stages.seeds import item_generator, item_seed


@dataclass(frozen=True)
class Condition(Disturbance):
    """What differs from the test of holding; errors are in object frames, shoves in the hand frame."""

    gravity: Vectors  # (3,) unit vector, frame of the first object at the grasp


def draw_conditions(settings: RobustnessParameters, objects: int, run_seed: int, *names: str) -> tuple[Condition, ...]:
    """Return ``settings.conditions`` independent conditions, of which a longer list begins like a shorter one.

    Args:
        objects: how many there are.
        run_seed: the ``seed`` of ``params.yaml``.
        names: of the objects, in the order of picking.
    """
    return tuple(
        _condition(settings, objects, item_seed(run_seed, "robustness", index, *names))
        for index in range(settings.conditions)
    )


def _condition(settings: RobustnessParameters, objects: int, seed: int) -> Condition:
    gravity = item_generator(seed, "gravity").normal(size=3)
    drawn = draw_disturbance(settings.distribution, seed, objects)
    return Condition(**vars(drawn), gravity=gravity / np.linalg.norm(gravity))
