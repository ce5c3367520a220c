"""A tiny model of made-up grasps: seconds of training, and an answer that is known."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from pipeline.hand.model import load_hand
from pipeline.records.parameters.train import (
    DenoiserParameters,
    DiffusionParameters,
    EncoderParameters,
    OptimizationParameters,
    TrainDataParameters,
    TrainingParameters,
)
from pipeline.records.poses import position_quaternion
from tests.synthesize import shapes

FIRSTS, SECONDS = ("cube", "ball"), ("can", "slender")


@pytest.fixture(scope="session")
def settings() -> TrainingParameters:
    return TrainingParameters(
        data=TrainDataParameters(held_out=0.1),
        encoder=EncoderParameters(points=64, clouds=2, centres=[16, 8, 4], neighbours=[8, 8, 4], widths=[8, 8, 16]),
        denoiser=DenoiserParameters(width=32, blocks=2, slot_width=4),
        diffusion=DiffusionParameters(),
        optimization=OptimizationParameters(steps=12, batch=16, record_every=4),
    )


@pytest.fixture(scope="session")
def objects():
    found = [shapes.box("cube"), shapes.box("ball"), shapes.cylinder("can"), shapes.cylinder("slender")]
    return {item.name: item for item in found}


def merged_table(first: str, second: str, count: int = 24, seed: int = 0) -> pd.DataFrame:
    """Accepted rows that scatter about a grasp that depends on the pair, and one rejected row."""
    rng = np.random.default_rng(seed + 2 * FIRSTS.index(first) + SECONDS.index(second))
    hand = load_hand("allegro")
    rows = []
    for index in range(count + 1):
        row = {
            "merged_id": index,
            "object0": first,
            "object1": second,
            "grasp0_id": int(rng.integers(10)),
            "grasp1_id": int(rng.integers(10)),
            "q": (hand.lower + hand.upper) / 2 + 0.05 * rng.normal(size=16),
            "rejected_by": "" if index < count else "fingers",
        }
        for slot, (name, names) in enumerate(((first, FIRSTS), (second, SECONDS))):
            T = np.eye(4)
            T[:3, :3] = Rotation.from_rotvec([0.02 * rng.normal(), 0.0, 1.0 + names.index(name)]).as_matrix()
            T[:3, 3] = [0.1 - 0.05 * slot, 0.02 * names.index(name), 0.001 * rng.normal()]
            row[f"position_hand_object{slot}"], row[f"quaternion_hand_object{slot}"] = position_quaternion(T)
        rows.append(row)
    return pd.DataFrame(rows)


@pytest.fixture(scope="session")
def tables():
    return {(first, second): merged_table(first, second) for first in FIRSTS for second in SECONDS}
