"""Parquet tables: their columns, units and meaning, and how they are read and written.

Every table keeps rejected rows too; ``rejected_by`` names the first check that a row failed and is empty for a row
that passed. Lengths are metres, angles radians, quaternions wxyz, ``position_a_b`` and ``quaternion_a_b`` together
are ``T_a_b`` (maps coordinates in b to a). ``q`` is always in the order of ``joints`` in the hand's description, for
the Allegro ``joint_0.0`` ... ``joint_15.0``. A table of another hand names it in the file's metadata, see ``of_hand``.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.records import energy_terms
from pipeline.records.errors import UserError
from pipeline.records.hands import ALLEGRO, ALLEGRO_JOINTS, ARM_JOINTS
from pipeline.records.writing import whole_file

MOST_VALUES = 1_000_000_000  # in one file: six times what a million grasps of two objects have


def _vector(length: int) -> pa.DataType:
    return pa.list_(pa.float64(), length)


_HAND = b"hand"
_VECTORS = pa.list_(_vector(3))
# Vectors that are null where a check was not reached: parquet cannot read nulls back from lists of fixed length.
_OPTIONAL_VECTOR = pa.list_(pa.float64())
_OPTIONAL_VECTORS = pa.list_(_OPTIONAL_VECTOR)

# One row per Markov chain of the synthesis: its best state, re-scored against the exact mesh.
CANDIDATES = pa.schema(
    [
        ("grasp_id", pa.int32()),
        ("object", pa.string()),
        ("style", pa.string()),  # pinch | side
        ("fingers", pa.string()),  # who touches, such as thumb+index, thumb+index+middle, ring+palm
        ("position_object_hand", _vector(3)),
        ("quaternion_object_hand", _vector(4)),
        ("q", _vector(ALLEGRO_JOINTS)),
        ("contact_candidates", pa.list_(pa.int32())),  # indices into Hand.contact_points
        ("contact_points", _VECTORS),  # object frame, on the hand's surface
        ("contact_normals", _VECTORS),  # object frame, outward normal of the object's surface at the closest point
        *((column, pa.float64()) for column in energy_terms.COLUMNS.values()),
        ("rejected_by", pa.string()),
    ]
)


def _column(name: str, kind: pa.DataType, description: str) -> pa.Field:
    """A column that says what it holds, unit first: ``description(field)``."""
    return pa.field(name, kind, metadata={"description": description})


def description(column: pa.Field) -> str:
    """Return what a column holds."""
    return column.metadata[b"description"].decode()  # type: ignore[no-any-return]


# What the checks of ``validate`` add to a candidate's row. Null where a check was not reached.
CHECKED = pa.schema(
    [
        _column("squeeze_q", _OPTIONAL_VECTOR, "rad, joint targets that press the contacts together"),
        _column("open_q", _OPTIONAL_VECTOR, "rad, joint positions for the approach"),
        _column(
            "approach_direction",
            _OPTIONAL_VECTOR,
            "unit vector, object frame, from the grasp towards where the hand comes from",
        ),
        _column(
            "gravity_drift",
            pa.list_(pa.float64()),
            "m, motion in the hand per gravity direction tested, in the order of the parameter",
        ),
        _column("gravity_rotation", pa.list_(pa.float64()), "rad, rotation in the hand, likewise"),
        _column("gravity_in_contact", pa.list_(pa.bool_()), "an assigned link presses at the end, likewise"),
        _column("contact_only_pass", pa.bool_(), "the paper's rule: some link presses in all six directions"),
        _column("table_approach_push", pa.float64(), "m, how far the object moved before the fingers closed"),
        _column(
            "table_drift", pa.float64(), "m, motion in the hand from the end of the squeeze to the end of the hold"
        ),
        _column("settling_drift", pa.float64(), "m, motion in the hand under a gentle squeeze alone; pinch only"),
    ]
)

# What the grip of one object could bear at best, of grasps that passed all checks; see docs/robustness.md.
MARGINS = pa.schema(
    [
        _column(
            "margin_mass_factor",
            pa.float64(),
            "largest multiple of the object's weight that the grip could bear, at `robustness.friction`",
        ),
        _column("margin_push_force", pa.float64(), "N, largest push in the worst direction that it could bear"),
        _column("margin_push_torque", pa.float64(), "N m, largest torque in the worst direction that it could bear"),
        _column(
            "margin_lowest_friction",
            pa.float64(),
            "least friction coefficient with which it could bear the weight; null above 2",
        ),
    ]
)

# What physics says of grasps that passed all checks; null where it was not asked.
ROBUSTNESS = pa.schema(
    [
        _column(
            "lowest_friction",
            pa.float64(),
            "lowest of `robustness.ladder` at which the grasp holds; null where it holds at none",
        ),
        _column("robustness", pa.float64(), "share of the drawn conditions that the grasp survives"),
        _column("robustness_low", pa.float64(), "lower end of its 95 % score interval (Wilson)"),
        _column("robustness_high", pa.float64(), "upper end of its 95 % score interval (Wilson)"),
    ]
)

# The candidates' rows after physics, without descriptions in the file.
VALIDATED = pa.schema([*CANDIDATES, *(column.remove_metadata() for column in (*CHECKED, *MARGINS, *ROBUSTNESS))])

# One row per tried combination of single grasps. Lists have an entry per object, in the order of picking; those of the
# approaches end where the checks ended. reports/dataset.md lists the descriptions, pair by pair.
MERGED = pa.schema(
    [
        _column("merged_id", pa.int32(), "number of the row among those of its objects, in the order of trial"),
        _column("objects", pa.list_(pa.string()), "names, in the order of picking"),
        _column("grasp_ids", pa.list_(pa.int32()), "`grasp_id` of the single grasp of each object"),
        _column("fingers", pa.list_(pa.string()), "who holds each object, such as `thumb+index`"),
        _column("q", _vector(ALLEGRO_JOINTS), "rad, joints of the grasp"),
        _column("squeeze_q", _vector(ALLEGRO_JOINTS), "rad, drive targets that press the contacts together"),
        _column("positions_hand_object", pa.list_(_vector(3)), "m, origin of each object in the hand frame"),
        _column(
            "quaternions_hand_object", pa.list_(_vector(4)), "w, x, y, z: turns vectors of its frame to the hand's"
        ),
        _column("open_q", pa.list_(_vector(ALLEGRO_JOINTS)), "rad, drive targets for the approach to each object"),
        _column(
            "approach_directions",
            pa.list_(_vector(3)),
            "unit vector, each object's frame, from the grasp towards where the hand comes from",
        ),
        _column(
            "approach_lengths",
            pa.list_(pa.float64()),
            "m, straight line that sweeps through nothing; null for the first object",
        ),
        _column(
            "sweep_penetrations",
            pa.list_(pa.int32()),
            "surface points that touch something on that line; null for the first object",
        ),
        _column(
            "object_clearance", pa.float64(), "m, smallest distance between two objects, all but the last squeezed"
        ),
        _column("hand_clearance", pa.float64(), "m, smallest distance of an object to links that do not hold it"),
        _column(
            "mount_clearance",
            pa.float64(),
            "m, least height of flange and mount over what an object after the first stands on",
        ),
        _column(
            "gravity_drift",
            pa.list_(pa.float64()),
            "m, motion in the hand per gravity direction tested, of the object that moves most",
        ),
        *(
            _column(f"{column.name}s", pa.list_(pa.float64()), f"{description(column)}, per object")
            for column in MARGINS
        ),
        *ROBUSTNESS,
        _column("rejected_by", pa.string(), "first failed check, empty for a grasp that passed all"),
    ]
)

# What a trial draws under a condition that is a distribution; null in all other trials. Lists have an entry per object,
# in the order of picking.
DRAWN = pa.schema(
    [
        _column("friction", pa.float64(), "friction coefficient of every two touching bodies"),
        _column("torque_limit", pa.float64(), "N m, torque limit of the hand's joints"),
        _column("latency", pa.int32(), "control periods by which targets arrive late"),
        _column("joint_errors", _OPTIONAL_VECTOR, "rad, measured less true joint angle: arm, then hand"),
        _column("mass_factors", pa.list_(pa.float64()), "mass / prepared mass"),
        _column("centre_offsets", _OPTIONAL_VECTORS, "m, centre of mass in the object's frame"),
        _column("position_errors", _OPTIONAL_VECTORS, "m, believed less true position, horizontal, world frame"),
        _column("rotation_errors", _OPTIONAL_VECTORS, "rad, rotation vector from true to believed, world frame"),
        _column("shoves", _OPTIONAL_VECTORS, "N, force while the object is carried, world frame"),
    ]
)

# One row per robot trial. Lists have an entry per object, in the order of picking.
TRIALS = pa.schema(
    [
        ("trial", pa.int32()),
        ("source", pa.string()),
        ("objects", pa.list_(pa.string())),
        ("merged_id", pa.int32()),
        ("seed", pa.int64()),
        ("offsets", pa.list_(_vector(3))),  # perturbation of the placement: x, y (m), yaw (rad)
        *(column.remove_metadata() for column in DRAWN),
        ("phase", pa.string()),  # last phase reached
        ("success", pa.bool_()),  # all >= 20 cm above rest for 2 s
        ("success_10cm", pa.bool_()),  # the released code's rule: all > 10 cm at the end of the last lift
        ("reason", pa.string()),  # empty on success
        ("heights", pa.list_(pa.float64())),  # m above rest, smallest during the hold (or when the trial ended)
        ("pushes", pa.list_(pa.float64())),  # m, how far each object moved before its fingers closed
        ("planning_attempts", pa.int32()),
        ("steps", pa.int32()),  # physics steps
        ("snapshot_phases", pa.list_(pa.string())),
        ("snapshot_robot_q", pa.list_(_vector(ARM_JOINTS + ALLEGRO_JOINTS))),  # rad, the arm, then the hand
        ("snapshot_poses", pa.list_(pa.list_(_vector(7)))),  # per object, per snapshot: position, quaternion (world)
    ]
)


_OF_JOINTS = {  # columns with a value per joint of the hand, by their type
    "q": _vector,
    "squeeze_q": _vector,
    "open_q": lambda joints: pa.list_(_vector(joints)),
    "snapshot_robot_q": lambda joints: pa.list_(_vector(ARM_JOINTS + joints)),
}


def of_hand(schema: pa.Schema, hand: str, joints: int) -> pa.Schema:
    """Return a schema of grasps or trials as it is for a hand: with that many joints, and its name in the metadata.

    The Allegro's tables are the schemas as they stand, without metadata.
    """
    if hand == ALLEGRO:
        return schema
    for name in schema.names:
        if name in _OF_JOINTS and schema.field(name).type == _OF_JOINTS[name](ALLEGRO_JOINTS):
            schema = schema.set(schema.get_field_index(name), schema.field(name).with_type(_OF_JOINTS[name](joints)))
    return schema.with_metadata({_HAND: hand})


def as_of_hand(schema: pa.Schema, other: pa.Schema) -> pa.Schema:
    """Return ``MERGED`` or ``TRIALS`` as it is for the hand of ``other``, which has joints in columns of like names."""
    for name in ("q", "snapshot_robot_q"):
        if name in schema.names and name in other.names:
            kind = other.field(name).type
            size = getattr(kind if name == "q" else getattr(kind, "value_type", kind), "list_size", 0)
            return of_hand(schema, hand_of_schema(other), size - (0 if name == "q" else ARM_JOINTS))
    return schema


def hand_of_schema(schema: pa.Schema) -> str:
    """Return the name of the hand whose grasps a table holds."""
    return (schema.metadata or {}).get(_HAND, ALLEGRO.encode()).decode()


def arrow_table(rows: pd.DataFrame, schema: pa.Schema) -> pa.Table:
    """Return ``rows`` with exactly the columns and types of ``schema``."""
    missing = set(schema.names) - set(rows.columns)
    if missing:
        raise ValueError(f"rows lack the columns {sorted(missing)}")
    arrays = [pa.array(rows[name].tolist(), type=schema.field(name).type, from_pandas=True) for name in schema.names]
    return pa.Table.from_arrays(arrays, schema=schema)


def write_arrow(target: Path, table: pa.Table) -> None:
    """Write a table; the same rows give the same bytes, however the table came about."""
    with whole_file(target) as temporary:
        pq.write_table(table.combine_chunks(), temporary, compression="zstd")


def write_table(target: Path, rows: pd.DataFrame, schema: pa.Schema) -> None:
    """Write ``rows`` with exactly the columns and types of ``schema``."""
    write_arrow(target, arrow_table(rows, schema))


def read_table(source: Path, schema: pa.Schema, made_by: str) -> pd.DataFrame:
    """Read a table and check its columns.

    Args:
        made_by: the DVC stage that writes the file, named in errors.

    Raises:
        UserError: the file is missing, damaged, of another hand, or has other columns. ``MERGED`` and ``TRIALS`` stand
            for the tables of every hand.
    """
    return read_arrow(source, schema, made_by, schema.names).to_pandas(ignore_metadata=True)


def read_columns(source: Path, schema: pa.Schema, made_by: str, columns: Sequence[str]) -> dict[str, list[Any]]:
    """Read some columns of a table as lists, which takes a tenth of the time of a data frame where rows are few.

    Args, Raises: see :func:`read_table`.
    """
    return read_arrow(source, schema, made_by, columns).to_pydict()


def read_arrow(source: Path, schema: pa.Schema, made_by: str, columns: Sequence[str]) -> pa.Table:
    """Read some columns of a table; see :func:`read_table`."""
    mend = f"run `dvc repro {made_by}` to make it again"
    if not source.exists():
        raise UserError(f"{source} is missing; {mend}.")
    try:
        check_size(source)
        file = pq.ParquetFile(source)
        if any(schema.equals(one, check_metadata=True) for one in (MERGED, TRIALS)):
            schema = as_of_hand(schema, file.schema_arrow)
        written, wanted = hand_of_schema(file.schema_arrow), hand_of_schema(schema)
        if written != wanted:
            raise UserError(
                f"{source} holds grasps of the hand {written}, not of the {wanted}; run `dvc repro {made_by}` with "
                f"hand: {wanted} in params.yaml to make them."
            )
        if not file.schema_arrow.equals(schema):
            raise UserError(f"{source} has other columns than this version expects; delete it and {mend}.")
        return file.read(list(columns), use_threads=False).select(columns)
    except (pa.ArrowException, OSError, ValueError) as error:
        raise UserError(f"{source} is damaged or not a parquet file; delete it and {mend}.") from error


def rows_of(table: pd.DataFrame, objects: Sequence[str]) -> pd.DataFrame:
    """Return the rows of ``MERGED`` or ``TRIALS`` that are about these objects, picked in this order."""
    own = [tuple(names) == tuple(objects) for names in table["objects"]]
    return table[np.array(own, dtype=bool)].reset_index(drop=True)


def check_size(source: Path | BinaryIO) -> None:
    """Refuse a parquet file that claims more values than memory could hold: a few bytes can stand for any number.

    Raises:
        ValueError: it does; or, of pyarrow's kinds, it is no parquet file.
    """
    facts = pq.read_metadata(source)
    groups = [facts.row_group(index) for index in range(facts.num_row_groups)]
    values = [group.column(index).num_values for group in groups for index in range(group.num_columns)]
    if max(facts.num_rows, sum(values)) > MOST_VALUES or min(values, default=0) < 0:
        raise ValueError(f"it claims {sum(values)} values")
