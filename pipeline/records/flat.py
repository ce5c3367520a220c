"""Tables of pairs with a column per object: ``object0`` and ``object1`` in the place of the list ``objects``.

Files hold lists (``MERGED`` and ``TRIALS`` of ``records.tables``), for any number of objects. Whoever works on two
objects alone reads them with the columns of ``PAIR_GRASPS`` and ``PAIR_TRIALS``. Reading with any other schema is
reading the table as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.records import tables
from pipeline.records.errors import UserError
from pipeline.records.tables import MARGINS, MERGED, ROBUSTNESS, TRIALS, description

OBJECTS = 2
_LIST, _PLACE = b"list", b"place"  # the column of lists that a column is taken from, and its place there
_VECTOR = pa.list_(pa.float64())  # or null, where a check was not reached


def _part(name: str, source: str, place: int, kind: pa.DataType, description: str = "") -> pa.Field:
    annotation = {b"description": description.encode()} if description else {}
    return pa.field(name, kind, metadata={**annotation, _LIST: source.encode(), _PLACE: str(place).encode()})


def _vector(length: int) -> pa.DataType:
    return pa.list_(pa.float64(), length)


_TEXT, _NUMBER, _COUNT = pa.string(), pa.float64(), pa.int32()
PAIR_GRASPS = pa.schema(
    [
        MERGED.field("merged_id").with_metadata(
            {"description": "number of the row in its pair, in the order of trial"}
        ),
        _part("object0", "objects", 0, _TEXT, "object picked first, held by thumb, index and middle finger"),
        _part("object1", "objects", 1, _TEXT, "object picked second, held by ring finger and palm"),
        _part(
            "grasp0_id",
            "grasp_ids",
            0,
            _COUNT,
            "`grasp_id` of the pinch grasp in `data/validate/pinch/<object0>.parquet`",
        ),
        _part(
            "grasp1_id",
            "grasp_ids",
            1,
            _COUNT,
            "`grasp_id` of the side grasp in `data/validate/side/<object1>.parquet`",
        ),
        _part("fingers0", "fingers", 0, _TEXT, "who holds object 0, such as `thumb+index`"),
        _part("fingers1", "fingers", 1, _TEXT, "who holds object 1: `ring+palm`"),
        MERGED.field("q").with_metadata(
            {"description": "rad, joints of the grasp: index, middle, ring, thumb, four each, from the base"}
        ),
        _part(
            "position_hand_object0", "positions_hand_object", 0, _vector(3), "m, origin of object 0 in the hand frame"
        ),
        _part(
            "quaternion_hand_object0",
            "quaternions_hand_object",
            0,
            _vector(4),
            "w, x, y, z: turns vectors of object 0's frame to the hand's",
        ),
        _part(
            "position_hand_object1", "positions_hand_object", 1, _vector(3), "m, origin of object 1 in the hand frame"
        ),
        _part(
            "quaternion_hand_object1",
            "quaternions_hand_object",
            1,
            _vector(4),
            "w, x, y, z: turns vectors of object 1's frame to the hand's",
        ),
        MERGED.field("squeeze_q"),
        _part(
            "open_q0",
            "open_q",
            0,
            _VECTOR,
            "rad, joints for the approach to object 0: pinching fingers open, ring finger out of the way",
        ),
        _part(
            "open_q1",
            "open_q",
            1,
            _VECTOR,
            "rad, drive targets for the approach to object 1: pinching fingers squeeze, ring finger open",
        ),
        _part(
            "approach_direction0",
            "approach_directions",
            0,
            _VECTOR,
            "unit vector, object 0's frame, from the grasp towards where the hand comes from",
        ),
        _part("approach_direction1", "approach_directions", 1, _VECTOR, "the same for object 1, in its frame"),
        _part(
            "approach_length1",
            "approach_lengths",
            1,
            _NUMBER,
            "m, straight line to object 1 that sweeps through nothing",
        ),
        MERGED.field("object_clearance").with_metadata(
            {"description": "m, smallest distance between the objects, the first one squeezed"}
        ),
        MERGED.field("hand_clearance"),
        MERGED.field("mount_clearance").with_metadata(
            {"description": "m, height of flange and mount over the plane that object 1 stands on"}
        ),
        _part(
            "sweep_penetrations",
            "sweep_penetrations",
            1,
            _COUNT,
            "surface points that touch something on the way to object 1",
        ),
        MERGED.field("gravity_drift").with_metadata(
            {"description": "m, motion in the hand per gravity direction tested, of the object that moves more"}
        ),
        *(
            _part(f"{column.name}{place}", f"{column.name}s", place, _NUMBER, f"{description(column)}, object {place}")
            for column in MARGINS
            for place in range(OBJECTS)
        ),
        *ROBUSTNESS,
        MERGED.field("rejected_by"),
    ]
)
PAIR_TRIALS = pa.schema(
    [
        TRIALS.field("trial"),
        TRIALS.field("source"),
        _part("object0", "objects", 0, _TEXT),
        _part("object1", "objects", 1, _TEXT),
        TRIALS.field("merged_id"),
        TRIALS.field("seed"),
        _part("offset0", "offsets", 0, _vector(3)),
        _part("offset1", "offsets", 1, _vector(3)),
        *(TRIALS.field(name) for name in ("friction", "torque_limit", "latency", "joint_errors")),
        *(_part(f"mass_factor{place}", "mass_factors", place, _NUMBER) for place in range(OBJECTS)),
        *(
            _part(f"{name}{place}", f"{name}s", place, _VECTOR)
            for name in ("centre_offset", "position_error", "rotation_error", "shove")
            for place in range(OBJECTS)
        ),
        *(TRIALS.field(name) for name in ("phase", "success", "success_10cm", "reason")),
        _part("height0", "heights", 0, _NUMBER),
        _part("height1", "heights", 1, _NUMBER),
        _part("push1", "pushes", 1, _NUMBER),
        *(TRIALS.field(name) for name in ("planning_attempts", "steps", "snapshot_phases", "snapshot_robot_q")),
        _part("snapshot_pose0", "snapshot_poses", 0, pa.list_(_vector(7))),
        _part("snapshot_pose1", "snapshot_poses", 1, pa.list_(_vector(7))),
    ]
)


def stored(schema: pa.Schema) -> pa.Schema:
    """Return the schema of the files that are read with the columns of ``schema``."""
    for pairs, whole in ((PAIR_GRASPS, MERGED), (PAIR_TRIALS, TRIALS)):
        if schema.names == pairs.names:
            return tables.as_of_hand(whole, schema)
    return schema


def flat(table: pa.Table, schema: pa.Schema) -> pa.Table:
    """Return the columns of ``schema``, one of this module, from a table that holds lists.

    Raises:
        UserError: a row is about another number of objects than two.
    """
    if set(pc.unique(pc.list_value_length(table["objects"])).to_pylist()) - {OBJECTS}:
        raise UserError("its rows are not about two objects each; choose a table of pairs.")
    for name in ("q", "squeeze_q", "snapshot_robot_q"):  # as many values as the hand of the table has joints
        if name in schema.names:
            column = schema.get_field_index(name)
            schema = schema.set(column, schema.field(column).with_type(table.schema.field(name).type))
    return pa.Table.from_arrays([_values(table, field) for field in schema], schema=schema)


def _values(table: pa.Table, field: pa.Field) -> pa.Array | pa.ChunkedArray:
    """Return the column of a field; null where a list ends before its place."""
    facts = field.metadata or {}
    if _LIST not in facts:
        return table[field.name].cast(field.type)
    lists = table[facts[_LIST].decode()].combine_chunks()
    place = int(facts[_PLACE])
    there = pc.fill_null(pc.greater(pc.list_value_length(lists), place), False)
    begins = lists.offsets[:-1] if len(lists) else pa.array([], pa.int32())
    return lists.values.take(pc.if_else(there, pc.add(begins, place), None)).cast(field.type)


def _needed(schema: pa.Schema, columns: Sequence[str]) -> list[str]:
    """Return the columns of files that hold ``columns``, and the one that says how many objects there are."""
    sources = [(schema.field(name).metadata or {}).get(_LIST, name.encode()).decode() for name in columns]
    return list(dict.fromkeys([*sources, "objects"]))


def _read(source: Path, schema: pa.Schema, made_by: str, columns: Sequence[str]) -> pa.Table:
    if stored(schema) is schema:
        return tables.read_arrow(source, schema, made_by, columns)
    found = tables.read_arrow(source, stored(schema), made_by, _needed(schema, columns))
    try:
        return flat(found, pa.schema([schema.field(name) for name in columns]))
    except UserError as error:
        raise UserError(f"{source}: {error}") from error


def read_flat(source: Path, schema: pa.Schema, made_by: str, columns: Sequence[str] = ()) -> pd.DataFrame:
    """Read a table with the columns of ``schema``, or only some of them; see ``records.tables.read_table``.

    Raises:
        UserError: as there, or the table is about another number of objects than two.
    """
    return _read(source, schema, made_by, columns or schema.names).to_pandas(ignore_metadata=True)


def read_flat_columns(source: Path, schema: pa.Schema, made_by: str, columns: Sequence[str]) -> dict[str, list[Any]]:
    """Read some columns as lists; see ``records.tables.read_columns`` and :func:`read_flat`."""
    return _read(source, schema, made_by, columns).to_pydict()


def pair_rows(table: pd.DataFrame, second: str) -> pd.DataFrame:
    """Return the rows of one pair, from a table of grasps or trials of all pairs that begin with one object."""
    return table[table["object1"] == second].reset_index(drop=True)
