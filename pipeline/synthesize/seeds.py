"""First states of the chains: where the hand stands before it looks for a grasp.

The distributions are part of the hand's description (``styles``). Draws that start inside the object or under the table
are drawn again (a third of the published pinch draws, four side draws of five).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.special import ndtr, ndtri

from pipeline.energy.keep_out import fingers_used
from pipeline.energy.scene import EnergyScene, Grasps
from pipeline.hand.model import Hand
from pipeline.hand.moves import finger_joints, straight
from pipeline.records.errors import UserError
from pipeline.records.parameters.hand import PALM
from pipeline.records.parameters.synthesize import StyleParameters

JITTER = 0.1  # standard deviation of joints, share of their range (released code)
ROTATION_NOISE = 0.1  # rad per axis; the released code adds it to the entries of its 6-D rotation
ATTEMPTS = 60  # draws per chain before the least colliding one is taken
HELD_SPREAD = 0.1  # rad, spread of joints that stay where they are drawn


def free_joints(hand: Hand, style: str, settings: StyleParameters, waiting: Sequence[str] = ()) -> NDArray[np.bool_]:
    """Return (J,) joints that synthesis may move; the others belong to the other objects in the hand.

    Args:
        waiting: fingers that will pick other objects later.
    """
    free = np.ones(hand.joint_count, dtype=bool)
    if not settings.released_seeds:
        held = {*hand.style(style).held} - {*fingers_used(settings.finger_sets)}
        free[finger_joints(sorted(held), hand)] = False
        free[finger_joints(waiting, hand)] = False
    return free


def mean_posture(hand: Hand, style: str, settings: StyleParameters, waiting: Sequence[str] = ()) -> NDArray[np.float64]:
    """Return the joints (J,), rad, about which first hands are drawn.

    Args:
        waiting: fingers that are straight meanwhile, as they pick other objects later.

    Raises:
        UserError: the hand has no released posture and ``settings`` asks for it.
    """
    described = hand.style(style)
    if settings.released_seeds:
        if described.released_posture is None:
            raise UserError(
                f"params.yaml: synthesize.{style}.released_seeds needs a released_posture, which the hand {hand.name} "
                "does not have; set it to false."
            )
        return np.array(described.released_posture)
    posture = np.array(described.posture)
    if described.curled_like is not None:
        for finger in set(fingers_used(settings.finger_sets)) - {PALM}:
            posture[finger_joints([finger], hand)] = np.array(described.posture)[
                finger_joints([described.curled_like], hand)
            ]
    posture[finger_joints(waiting, hand)] = straight(waiting, hand)
    return posture


def perturbed_columns(R: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """Return the rotation (3, 3) whose first two columns are those of ``R`` with noise on each of the six entries.

    The released code's 6-D rotation: the noisy columns a and b are made orthogonal by turning both alike, so that their
    bisectors unit(a) + unit(b) and unit(a) - unit(b), which are orthogonal, stay what they are.
    """
    noisy = R[:, :2] + ROTATION_NOISE * rng.normal(size=(3, 2))
    a, b = (noisy / np.linalg.norm(noisy, axis=0)).T
    along, across = (a + b) / np.linalg.norm(a + b), (a - b) / np.linalg.norm(a - b)
    x, y = (along + across) / np.sqrt(2.0), (along - across) / np.sqrt(2.0)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def minimal_rotation(start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation matrix (3, 3) by the least angle that takes the unit vector ``start`` to ``end``."""
    axis = np.cross(start, end)
    sine, cosine = float(np.linalg.norm(axis)), float(start @ end)
    if sine < 1e-12:
        return np.eye(3)
    return Rotation.from_rotvec(axis / sine * np.arctan2(sine, cosine)).as_matrix()


def _truncated_normal(
    rng: np.random.Generator, mean: NDArray[np.float64], sigma: NDArray[np.float64], hand: Hand
) -> NDArray[np.float64]:
    low, high = ndtr((hand.lower - mean) / sigma), ndtr((hand.upper - mean) / sigma)
    return np.clip(mean + sigma * ndtri(low + rng.random(len(mean)) * (high - low)), hand.lower, hand.upper)


def draw_seed(
    hand: Hand,
    style: str,
    settings: StyleParameters,
    slots: Sequence[NDArray[np.float64]],
    rng: np.random.Generator,
    waiting: Sequence[str] = (),
) -> Grasps:
    """Return one draw (a batch of 1) of the first state of a chain."""
    described = hand.style(style)
    low, high = np.array(described.tilt.low), np.array(described.tilt.high)
    v = low + (high - low) * rng.random(3)
    R = minimal_rotation(np.array(described.tilt.axis), v / np.linalg.norm(v)) @ np.array(described.orientation)
    R = Rotation.from_euler("z", settings.heading_spread * rng.uniform(-1, 1)).as_matrix() @ R
    if settings.released_seeds:
        position = -(R @ hand.palm_normal) * rng.uniform(*settings.distance_from_palm)
        R = perturbed_columns(R, rng)
    else:
        R = R @ Rotation.from_rotvec(ROTATION_NOISE * rng.normal(size=3)).as_matrix()
        position = -(R @ hand.palm_normal) * rng.uniform(*settings.distance_from_palm)
    sigma = np.where(free_joints(hand, style, settings, waiting), JITTER * (hand.upper - hand.lower), HELD_SPREAD)
    q = _truncated_normal(rng, mean_posture(hand, style, settings, waiting), sigma, hand)
    contacts: list[int] = []
    for slot in slots:
        chances = slot.copy()
        chances[contacts] = 0.0
        contacts.append(int(rng.choice(len(chances), p=chances / chances.sum())))
    return Grasps(
        position=position[None],
        rotation=Rotation.from_matrix(R).as_quat(canonical=True, scalar_first=True)[None],
        q=q[None],
        contacts=np.array(contacts, dtype=np.int64)[None],
    )


def join(batches: Sequence[Grasps]) -> Grasps:
    """Return batches with the same number of contacts as one."""
    return Grasps(
        position=np.concatenate([batch.position for batch in batches]),
        rotation=np.concatenate([batch.rotation for batch in batches]),
        q=np.concatenate([batch.q for batch in batches]),
        contacts=np.concatenate([batch.contacts for batch in batches]),
    )


def draw_seeds(
    scene: EnergyScene,
    hand: Hand,
    style: str,
    settings: StyleParameters,
    slots: Sequence[NDArray[np.float64]],
    generators: Sequence[np.random.Generator],
    waiting: Sequence[str] = (),
) -> Grasps:
    """Return the first states of several chains, each from its own generator, free of collisions where possible.

    With ``released_seeds`` it is the first draw, whatever it collides with.
    """
    if settings.released_seeds:
        return join([draw_seed(hand, style, settings, slots, generator, waiting) for generator in generators])
    best: list[Grasps | None] = [None] * len(generators)
    least = np.full(len(generators), np.inf)
    open_chains = list(range(len(generators)))
    for _ in range(ATTEMPTS):
        draws = [draw_seed(hand, style, settings, slots, generators[int(chain)], waiting) for chain in open_chains]
        terms, _ = scene.evaluate(join(draws))
        overlap = terms.penetration + terms.table + terms.self_penetration
        for chain, draw, value in zip(open_chains, draws, overlap, strict=True):
            if value < least[chain]:
                best[chain], least[chain] = draw, value
        open_chains = [chain for chain, value in zip(open_chains, overlap, strict=True) if value > 0]
        if not open_chains:
            break
    return join([draw for draw in best if draw is not None])
