"""Small tables of grasps, drawn at random: poses are proper, nothing else has a meaning."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.records import paths
from pipeline.records.flat import PAIR_GRASPS
from pipeline.records.tables import VALIDATED, write_table
from tests.pairs import write_pairs

PINCH, SIDE = ("cube", "plum"), ("can",)
STYLES = {"pinch": list(PINCH), "side": list(SIDE)}
PARAMETERS = {"seed": 1, "styles": STYLES, "pairs": "all"}  # of params.yaml, as far as sharing reads it


def _unit(generator: np.random.Generator, size: int) -> list[float]:
    vector = generator.normal(size=size)
    return (vector / np.linalg.norm(vector)).tolist()


def validated(object_name: str, style: str, generator: np.random.Generator) -> pd.DataFrame:
    """Six single grasps, of which number 3 was rejected; a pinch has two or three contacts."""
    rows = []
    for number in range(6):
        contacts = 3 if style == "pinch" and number % 2 else 2
        row = dict.fromkeys(VALIDATED.names) | {
            "grasp_id": number,
            "object": object_name,
            "style": style,
            "fingers": "thumb+index" if style == "pinch" else "ring+palm",
            "position_object_hand": generator.normal(scale=0.1, size=3).tolist(),
            "quaternion_object_hand": _unit(generator, 4),
            "q": generator.uniform(0, 1, 16).tolist(),
            "contact_candidates": generator.integers(0, 143, contacts).tolist(),
            "contact_points": [[0.0, 0.0, 0.0]] * contacts,
            "contact_normals": [[0.0, 0.0, 1.0]] * contacts,
            "rejected_by": "gravity" if number == 3 else "",
        }
        rows.append(row)
    return pd.DataFrame(rows)


def merged(first: str, second: str, generator: np.random.Generator) -> pd.DataFrame:
    """Five combinations, of which number 1 was rejected."""
    rows = []
    for number in range(5):
        row = dict.fromkeys(PAIR_GRASPS.names) | {
            "merged_id": number,
            "object0": first,
            "object1": second,
            "grasp0_id": (0, 1, 2, 4, 5)[number],
            "grasp1_id": number,
            "fingers0": "thumb+index",
            "fingers1": "ring+palm",
            "q": generator.uniform(0, 1, 16).tolist(),
            "squeeze_q": generator.uniform(0, 1, 16).tolist(),
            "rejected_by": "object penetration" if number == 1 else "",
        }
        for index in (0, 1):
            row[f"position_hand_object{index}"] = generator.normal(scale=0.1, size=3).tolist()
            row[f"quaternion_hand_object{index}"] = _unit(generator, 4)
        rows.append(row)
    return pd.DataFrame(rows)


def write_tables(root: Path, *, learned: bool = True) -> None:
    """Write merged, learned and single grasps of all pairs below ``root``."""
    generator = np.random.default_rng(7)
    for first in PINCH:
        files = [paths.merged_file(first), *([paths.sampled_file("learned", first)] if learned else [])]
        for file in files:
            write_pairs(root / file, pd.concat([merged(first, second, generator) for second in SIDE]), PAIR_GRASPS)
    for style, names in STYLES.items():
        for name in names:
            write_table(root / paths.validated_file(style, name), validated(name, style, generator), VALIDATED)
