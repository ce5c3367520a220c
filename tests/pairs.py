"""The sequence of the paper, and tables of it, written from rows with a column per object."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pyarrow as pa

from pipeline.records.flat import stored
from pipeline.records.parameters.picks import PickParameters
from pipeline.records.tables import write_table

PAIR = tuple(PickParameters.model_validate({"style": style}) for style in ("pinch", "side"))


def write_pairs(target: Path, rows: pd.DataFrame, schema: pa.Schema) -> None:
    """Write rows with the columns of ``PAIR_GRASPS`` or ``PAIR_TRIALS`` as the stages do, with lists."""
    own, lists = {}, {}
    for field in schema:
        facts = field.metadata or {}
        if b"list" in facts:
            lists.setdefault(facts[b"list"].decode(), {})[int(facts[b"place"])] = rows[field.name].tolist()
        else:
            own[field.name] = rows[field.name].tolist()
    for name, columns in lists.items():
        parts = [columns.get(place, [None] * len(rows)) for place in (0, 1)]
        kind = stored(schema).field(name).type.value_type
        optional = pa.types.is_primitive(kind)  # others end where a value is missing
        own[name] = [
            [value for value in each if optional or isinstance(value, str) or value is not None]
            for each in zip(*parts, strict=True)
        ]
    write_table(target, pd.DataFrame(own, dtype=object), stored(schema))
