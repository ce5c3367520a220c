"""Digests of values and files: the parts of an item's fingerprint."""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from pydantic import BaseModel

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.hands import description_file


def digest(*values: Any) -> str:
    """Return the same 32 hex digits for equal values.

    Values are numbers, texts, bytes, None, arrays, parquet tables, models of parameters, data classes, and lists and
    dictionaries of them; the order in a dictionary does not matter.
    """
    hashed = hashlib.sha256()
    _add(hashed, values)
    return hashed.hexdigest()[:32]


def _add(hashed: Any, value: Any) -> None:
    if isinstance(value, BaseModel):
        value = value.model_dump(mode="json")
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    elif hasattr(value, "to_reader"):  # a pyarrow table
        value = _bytes_of_table(value)
    if isinstance(value, dict):
        hashed.update(f"d{len(value)};".encode())
        for name in sorted(value, key=repr):
            _add(hashed, name)
            _add(hashed, value[name])
    elif isinstance(value, list | tuple):
        hashed.update(f"l{len(value)};".encode())
        for each in value:
            _add(hashed, each)
    elif isinstance(value, np.ndarray):
        hashed.update(f"a{value.dtype.str}{value.shape};".encode())
        hashed.update(np.ascontiguousarray(value).tobytes())
    else:
        value = value.item() if isinstance(value, np.generic) else value
        content = value if isinstance(value, bytes) else json.dumps(value).encode()
        hashed.update(f"{type(value).__name__}{len(content)};".encode())
        hashed.update(content)


def _bytes_of_table(table: Any) -> bytes:
    """Return bytes that depend on the values alone, not on how the table lies in memory."""
    target = io.BytesIO()
    pq.write_table(table.combine_chunks(), target, compression="none")
    return target.getvalue()


def file_digest(source: Path, made_by: str) -> str:
    """Return the digest of a file's content.

    Raises:
        UserError: the file is missing; ``made_by`` names the stage that makes it.
    """
    try:
        facts = source.stat()
        return _file_digest(source.absolute(), facts.st_mtime_ns, facts.st_size)
    except FileNotFoundError as error:
        raise UserError(f"{source} is missing; run `dvc repro {made_by}` to make it.") from error


@cache
def _file_digest(source: Path, changed: int, size: int) -> str:
    return hashlib.sha256(source.read_bytes()).hexdigest()[:32]


def folder_digest(folder: Path, made_by: str, but: str = "") -> str:
    """Return the digest of all files below a folder, except those whose names end in ``but``.

    Raises:
        UserError: there are none; ``made_by`` names the stage that makes them.
    """
    files = sorted(path for path in folder.rglob("*") if path.is_file() and not (but and path.name.endswith(but)))
    if not files:
        raise UserError(f"{folder} is missing or empty; run `dvc repro {made_by}` to make it.")
    return digest({path.relative_to(folder).as_posix(): file_digest(path, made_by) for path in files})


def prepared_digest(name: str) -> str:
    """Return the digest of a prepared object, its picture left out.

    Raises:
        UserError: it is missing.
    """
    return folder_digest(paths.prepared_folder(name), "prepare", but=".png")


def hand_digest(hand: str) -> str:
    """Return the digest of a hand's description."""
    return folder_digest(description_file(hand).parent, "code")
