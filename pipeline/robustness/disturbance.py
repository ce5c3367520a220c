"""What differs from the setting that a grasp was made for, drawn from ranges: in tests of robustness and in trials."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.records.parameters.distribution import DisturbedGrasp
from pipeline.stages.seeds import item_generator

Vectors = NDArray[np.float64]


@dataclass(frozen=True)
class Disturbance:
    """One draw for a hand with n objects. Whoever uses it says in which frame errors and shoves are."""

    friction: float  # of every two touching bodies
    torque_limit: float  # N m, of the hand's joints
    mass_factors: Vectors  # (n,)
    centre_offsets: Vectors  # (n, 3) m, object frames
    position_errors: Vectors  # (n, 3) m
    rotation_errors: Vectors  # (n, 3) rad, rotation vectors
    shoves: Vectors  # (n, 3) N


def draw_disturbance(ranges: DisturbedGrasp, seed: int, objects: int, level: bool = False) -> Disturbance:
    """Return the draw of one test or trial.

    Lengths and angles are uniform up to their maximum, directions uniform on the sphere; a centre of mass is uniform in
    a ball. Every quantity has a generator of its own, so that with another range it is stretched and the others stay.

    Args:
        level: whether errors of position are horizontal.
    """

    def rng(quantity: str) -> np.random.Generator:
        return item_generator(seed, "disturbance", quantity)

    def lengths(quantity: str, most: float, power: float = 1.0) -> Vectors:
        return most * rng(f"{quantity} length").uniform(size=(objects, 1)) ** power

    def directions(quantity: str, axes: int = 3) -> Vectors:
        vectors = rng(f"{quantity} direction").normal(size=(objects, axes))
        vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
        return np.pad(vectors, ((0, 0), (0, 3 - axes)))

    lightest, heaviest = np.log(ranges.mass_factor)
    return Disturbance(
        friction=float(rng("friction").uniform(*ranges.friction)),
        torque_limit=float(rng("torque limit").uniform(*ranges.torque_limit)),
        mass_factors=np.exp(lightest + (heaviest - lightest) * rng("mass").uniform(size=objects)),
        centre_offsets=lengths("centre", ranges.centre_offset, 1 / 3) * directions("centre"),
        position_errors=lengths("position", ranges.position_error) * directions("position", 2 if level else 3),
        rotation_errors=lengths("rotation", ranges.rotation_error) * directions("rotation"),
        shoves=lengths("shove", ranges.shove_force) * directions("shove"),
    )
