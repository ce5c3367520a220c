"""Which rows of a merged table a model has not learned from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

STYLES = ("pinch", "side")  # how object 0 and object 1 are held


def unseen_rows(rows: pd.DataFrame, held_out: Mapping[str, Sequence[int]]) -> NDArray[np.bool_]:
    """Return which rows (N,) of a merged table have a single grasp in ``held_out``."""
    unseen = np.zeros(len(rows), dtype=bool)
    for slot, style in enumerate(STYLES):
        keys = zip(rows[f"object{slot}"], rows[f"grasp{slot}_id"], strict=True)
        unseen |= np.array([index in held_out.get(f"{style}.{name}", ()) for name, index in keys], dtype=bool)
    return unseen
