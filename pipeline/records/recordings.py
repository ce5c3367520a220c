"""What a trial looks like at every control period: joints and object poses over time, in one parquet file.

A recording holds all that a viewer or a video needs but meshes.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pipeline.records.errors import UserError
from pipeline.records.tables import check_size
from pipeline.records.texts import parse_json
from pipeline.records.writing import whole_file

_NUMBERS = pa.float64()
# One row per control period, at its end.
MOMENTS = pa.schema(
    [
        ("time", _NUMBERS),  # s of simulation since the trial began
        ("phase", pa.string()),  # being carried out
        ("robot_q", pa.list_(_NUMBERS)),  # rad, the arm's joints, then the hand's
        ("poses", pa.list_(pa.list_(_NUMBERS, 7))),  # m, position and quaternion wxyz of each object in the world
    ]
)
_ABOUT = b"trial"  # key of the file's metadata


@dataclass(frozen=True)
class About:
    """What was recorded."""

    name: str  # of the trial, such as synthesized/cube/soup_can/3
    objects: tuple[str, ...]  # in the order of picking
    outcome: str  # success, or the reason of the failure
    sponge_height: float  # m


@dataclass(frozen=True)
class Recording:
    """A trial over time; n moments."""

    about: About
    time: NDArray[np.float64]  # (n,) s
    phase: list[str]
    robot_q: NDArray[np.float64]  # (n, R) rad
    poses: NDArray[np.float64]  # (objects, n, 7) position (m) and quaternion wxyz of the objects in the world


def write_recording(target: Path, recording: Recording) -> None:
    """Write a recording; the same trial gives the same bytes.

    Raises:
        UserError: the folder cannot be written to.
    """
    about = recording.about
    text = {
        "name": about.name,
        "objects": list(about.objects),
        "outcome": about.outcome,
        "sponge_height": about.sponge_height,
    }
    columns = [recording.time, recording.phase, recording.robot_q, recording.poses.swapaxes(0, 1).tolist()]
    arrays = [pa.array(list(column), type=kind) for column, kind in zip(columns, MOMENTS.types, strict=True)]
    schema = MOMENTS.with_metadata({_ABOUT: json.dumps(text, sort_keys=True)})
    with whole_file(target) as temporary:
        pq.write_table(pa.Table.from_arrays(arrays, schema=schema), temporary, compression="zstd")


def read_recording(source: Path) -> Recording:
    """Read a recording.

    Raises:
        UserError: the file is missing, damaged, or no recording.
    """
    mend = "record the trial again with `./dev replay SOURCE/FIRST/SECOND/NUMBER --no-view`"
    if not source.is_file():
        raise UserError(f"{source} is missing; {mend}.")
    try:
        check_size(source)
        table = pq.read_table(source)
        about = parse_json((table.schema.metadata or {})[_ABOUT])
        known = About(about["name"], tuple(about["objects"]), about["outcome"], float(about["sponge_height"]))
    except (pa.ArrowException, OSError, KeyError, ValueError, TypeError) as error:
        raise UserError(f"{source} is damaged or no recording of a trial; {mend}.") from error
    if not table.schema.equals(MOMENTS) or not table.num_rows:
        raise UserError(f"{source} has other columns than this version expects; {mend}.")
    values = {name: table.column(name).to_pylist() for name in MOMENTS.names}
    return Recording(
        known,
        np.array(values["time"], np.float64),
        values["phase"],
        np.array(values["robot_q"], np.float64),
        np.array(values["poses"], np.float64).swapaxes(0, 1),
    )
