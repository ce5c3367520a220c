"""Objects and tables that many items of a stage need: each is read once and kept while the next items need it."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa

from pipeline.records import paths
from pipeline.records.flat import read_flat
from pipeline.records.objects import PreparedObject, load_prepared_object


def without_grid(prepared: PreparedObject) -> PreparedObject:
    """Return the object without its signed-distance grid, which trials do not need and workers would have to copy."""
    return replace(prepared, distance=np.zeros((0, 0, 0), np.float32))


def kept_object(name: str, grid: bool = True) -> PreparedObject:
    """Return a prepared object.

    Args:
        grid: with its signed-distance grid.

    Raises:
        UserError: it is missing or damaged.
    """
    return _object(paths.prepared_folder(name).absolute(), name, grid)


@lru_cache(maxsize=16)
def _object(place: Path, name: str, grid: bool) -> PreparedObject:
    prepared = load_prepared_object(name)
    return prepared if grid else without_grid(prepared)


def kept_table(source: Path, schema: pa.Schema, made_by: str) -> pd.DataFrame:
    """Return a table, which must not be changed; see ``records.flat.read_flat``."""
    return _table(source.absolute(), source, schema, made_by)


@lru_cache(maxsize=2)  # items of one first object come one after the other
def _table(place: Path, source: Path, schema: pa.Schema, made_by: str) -> pd.DataFrame:
    return read_flat(source, schema, made_by)
