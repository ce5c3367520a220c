"""The conditions under which grasps are tried: drawn once for an object or a pair, the same for all of its grasps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.records.parameters.robustness import RobustnessParameters
from pipeline.stages.seeds import item_generator

Vectors = NDArray[np.float64]


@dataclass(frozen=True)
class Condition:
    """What differs from the test of holding in which a grasp was accepted, for ``n`` objects."""

    friction: float  # of every two touching bodies
    torque_limit: float  # N m, of the hand's joints
    gravity: Vectors  # (3,) unit vector, frame of the first object at the grasp
    mass_factors: Vectors  # (n,)
    centre_offsets: Vectors  # (n, 3) m, object frames
    position_errors: Vectors  # (n, 3) m, object frames
    rotation_errors: Vectors  # (n, 3) rad, rotation vectors, object frames
    shoves: Vectors  # (n, 3) N, hand frame


def draw_conditions(settings: RobustnessParameters, objects: int, run_seed: int, *names: str) -> tuple[Condition, ...]:
    """Return ``settings.conditions`` independent conditions for some number of objects.

    Every quantity has a generator of its own, so that a longer list begins like a shorter one and another range
    stretches its quantity and leaves the others.

    Args:
        run_seed: the ``seed`` of ``params.yaml``.
        names: of the objects, in the order of picking.
    """
    count, ranges = settings.conditions, settings.distribution

    def rng(quantity: str) -> np.random.Generator:
        return item_generator(run_seed, "robustness", quantity, *names)

    def directions(quantity: str) -> Vectors:
        """Uniform on the sphere, (count, objects, 3)."""
        vectors = rng(f"{quantity} direction").normal(size=(count, objects, 3))
        return vectors / np.linalg.norm(vectors, axis=2, keepdims=True)

    def in_ball(quantity: str, radius: float) -> Vectors:
        """Uniform in a ball, (count, objects, 3)."""
        return radius * rng(quantity).uniform(size=(count, objects, 1)) ** (1 / 3) * directions(quantity)

    def along(quantity: str, most: float) -> Vectors:
        """Of uniform length in a uniform direction, (count, objects, 3)."""
        return most * rng(quantity).uniform(size=(count, objects, 1)) * directions(quantity)

    frictions = rng("friction").uniform(*ranges.friction, count)
    torques = rng("torque").uniform(*ranges.torque_limit, count)
    gravities = directions("gravity")[:, 0]
    lightest, heaviest = (float(np.log(factor)) for factor in ranges.mass_factor)
    masses = np.exp(rng("mass").uniform(lightest, heaviest, (count, objects)))
    centres = in_ball("centre", ranges.centre_offset)
    positions = in_ball("position", ranges.position_error)
    rotations = along("rotation", ranges.rotation_error)
    shoves = along("shove", ranges.shove_force)
    return tuple(
        Condition(
            friction=float(frictions[index]),
            torque_limit=float(torques[index]),
            gravity=gravities[index],
            mass_factors=masses[index],
            centre_offsets=centres[index],
            position_errors=positions[index],
            rotation_errors=rotations[index],
            shoves=shoves[index],
        )
        for index in range(count)
    )
