"""The format for everybody else: grasps as JSON or CSV, poses of the hand in the frame of each object's mesh."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.records.errors import UserError
from pipeline.records.texts import parse_json
from pipeline.score.foreign import ForeignFile, ForeignGrasp, Hold, entry, from_quaternions, numbers, texts

POSE_COLUMNS = ("x", "y", "z", "qw", "qx", "qy", "qz")
SQUEEZE = "squeeze:"  # before a joint's name, in the header of a column with its drive target
UNDERSTOOD = ("Poses are of the hand's root link in the frame of each object's mesh, in metres.",)
FORMS = {".json": "JSON", ".csv": "CSV"}


def read_json(source: Path, order: str) -> ForeignFile:
    """Read ``{"joint_names": [...], "grasps": [{"holds": [...], "joints": [...]}, ...]}``; see docs/lab.md."""
    try:
        content = parse_json(source.read_bytes())
    except (OSError, ValueError) as error:
        raise UserError(f"{source} is no JSON ({error}); correct it there.") from error
    names = texts(entry(content, "joint_names", source))
    records = entry(content, "grasps", source)
    if not isinstance(records, list):
        raise UserError(f"{source}: grasps is no list; correct it there.")
    grasps = []
    for index, record in enumerate(records):
        what = f"grasp {index}"
        holds = record["holds"] if isinstance(record, dict) and "holds" in record else [record]
        if not isinstance(holds, list) or not 1 <= len(holds) <= 2:
            raise UserError(f"{source}: {what} has holds of no, or more than two, objects; correct it there.")
        joints = numbers(entry(record, "joints", source), (len(names),), f"joints of {what}", source)
        squeeze = record.get("squeeze")
        if squeeze is not None:
            squeeze = numbers(squeeze, (len(names),), f"squeeze of {what}", source)
        grasps.append(ForeignGrasp(tuple(_hold(hold, what, order, source) for hold in holds), joints, squeeze))
    return ForeignFile(source, FORMS[".json"], tuple(grasps), names, understood=UNDERSTOOD)


def _hold(record: Any, what: str, order: str, source: Path) -> Hold:
    position = numbers(entry(record, "position", source), (3,), f"position of {what}", source)
    quaternion = numbers(entry(record, "quaternion", source), (4,), f"quaternion of {what}", source)
    T = from_quaternions(position[None], quaternion[None], order, source)[0]
    return Hold(T, _fingers(record.get("fingers", ())))


def _fingers(content: Any) -> tuple[str, ...]:
    """Return fingers given as a list, or as a text such as `thumb+index`."""
    names = re.split(r"\s*[+,]\s*", content.strip()) if isinstance(content, str) else content
    return tuple(str(name) for name in names if name)


def read_csv(source: Path, order: str) -> ForeignFile:
    """Read a line per grasp: x, y, z, qw, qx, qy, qz, a column per joint; see docs/lab.md for what may follow."""
    try:
        with source.open(newline="", encoding="utf-8") as file:
            rows = [row for row in csv.reader(file) if row]
    except (OSError, ValueError, csv.Error) as error:
        raise UserError(f"{source} is no CSV text ({error}); correct it there.") from error
    if not rows:
        raise UserError(f"{source} is empty; its first line names the columns.")
    header = [name.strip() for name in rows[0]]
    if len(set(header)) < len(header) or any(len(row) != len(header) for row in rows):
        raise UserError(
            f"{source}: every column needs a name of its own, and every line as many values; correct it there."
        )
    column = {name: [row[index].strip() for row in rows[1:]] for index, name in enumerate(header)}
    count = len(rows) - 1
    sets = [("", "fingers"), ("2", "fingers2")] if "x2" in column else [("", "fingers")]
    holds = [_column_of_holds(column, suffix, fingers, order, source) for suffix, fingers in sets]
    used = {name + suffix for suffix, _ in sets for name in POSE_COLUMNS} | {fingers for _, fingers in sets}
    names = [name for name in header if name not in used and not name.startswith(SQUEEZE)]
    joints = _table(column, names, source)
    pressed = [SQUEEZE + name for name in names]
    some = any(name in column for name in pressed)
    squeeze = _table(column, pressed, source) if some else None
    grasps = tuple(
        ForeignGrasp(tuple(own[index] for own in holds), joints[index], None if squeeze is None else squeeze[index])
        for index in range(count)
    )
    return ForeignFile(source, FORMS[".csv"], grasps, tuple(names), understood=UNDERSTOOD)


def _column_of_holds(column: dict[str, list[str]], suffix: str, fingers: str, order: str, source: Path) -> list[Hold]:
    pose = _table(column, [name + suffix for name in POSE_COLUMNS], source)
    quaternions = pose[:, 3:] if order == "wxyz" else np.roll(pose[:, 3:], -1, axis=1)  # columns have their names
    T = from_quaternions(pose[:, :3], quaternions, order, source)
    held_by = column.get(fingers, [""] * len(T))
    return [Hold(each, _fingers(names)) for each, names in zip(T, held_by, strict=True)]


def _table(column: dict[str, list[str]], names: list[str], source: Path) -> NDArray[np.float64]:
    for name in names:
        if name not in column:
            raise UserError(f"{source} has no column {name!r}; add it, see docs/lab.md.")
    values = [column[name] for name in names]
    return numbers(np.array(values, dtype=object).T.reshape(-1, len(names)), (None, len(names)), "a column", source)
