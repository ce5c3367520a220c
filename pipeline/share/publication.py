"""A folder that is ready for a data hub: grasps by split, meshes, the model, trials, and what describes them.

Layout::

    README.md            for people, with the header that hubs read
    croissant.json       the same for programs (Croissant 1.1)
    SHA256SUMS           checksums of everything else; `sha256sum -c SHA256SUMS`
    data/<source>/<split>-00000-of-00001.parquet   accepted two-object grasps
    objects/<name>.ply   meshes in the frames that grasps refer to
    dataset.md           how the grasps came about, by `report`
    model/               the checkpoint with a model card
    trials/              recorded trials as a LeRobot v3 data set
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.records.errors import UserError
from pipeline.records.flat import PAIR_GRASPS
from pipeline.records.tables import check_size, write_table
from pipeline.share.columns import GRASP_COLUMNS

CARD, CROISSANT, CHECKSUMS = "README.md", "croissant.json", "SHA256SUMS"
TRAIN, TEST = "train", "test"
TABLE = pa.schema(
    [
        pa.field("source", pa.string(), metadata={"description": GRASP_COLUMNS["source"]}),
        *(field.with_metadata({"description": field.metadata[b"description"]}) for field in PAIR_GRASPS),
    ]
)  # of a published table


@dataclass(frozen=True)
class Split:
    """The grasps of one table."""

    source: str  # of grasps, such as synthesized
    name: str  # train, or test: grasps that the model has not learned from
    rows: int
    path: str  # in the folder
    size: int  # bytes
    sha256: str


def split_path(source: str, split: str) -> str:
    """Return where a split lies in the folder."""
    return f"data/{source}/{split}-00000-of-00001.parquet"


def write_split(folder: Path, source: str, name: str, grasps: pd.DataFrame) -> Split:
    """Write one table and return what is known of it."""
    path = split_path(source, name)
    write_table(folder / path, grasps, TABLE)
    content = (folder / path).read_bytes()
    return Split(source, name, len(grasps), path, len(content), hashlib.sha256(content).hexdigest())


def write_checksums(folder: Path) -> None:
    """Write the checksums of all files, as `sha256sum` does."""
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path.name != CHECKSUMS)
    lines = [
        f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.relative_to(folder).as_posix()}\n" for path in files
    ]
    (folder / CHECKSUMS).write_text("".join(lines), encoding="utf-8")


def is_publication(folder: Path) -> bool:
    """Tell whether a folder is one that this module describes."""
    return (folder / CROISSANT).is_file() and (folder / "data").is_dir()


def published_tables(folder: Path, sources: list[str]) -> Iterator[pd.DataFrame]:
    """Yield the tables of some sources.

    Raises:
        UserError: one is missing, damaged, or has other columns.
    """
    for source in sources:
        files = sorted((folder / "data" / source).glob("*.parquet"))
        if not files:
            known = sorted(path.name for path in (folder / "data").iterdir() if path.is_dir())
            raise UserError(f"{folder} has no {source} grasps; choose among {', '.join(known) or 'none'}.")
        for file in files:
            yield _read(file)


def _read(file: Path) -> pd.DataFrame:
    try:
        check_size(file)
        table: Any = pq.read_table(file)
        missing = [name for name in TABLE.names if name not in table.column_names]
        if missing:
            raise UserError(f"{file} has no column {missing[0]}: another version of this project made it.")
        return table.select(TABLE.names).cast(TABLE).to_pandas(ignore_metadata=True)
    except (pa.ArrowException, OSError, ValueError) as error:
        raise UserError(f"{file} is damaged or no table of grasps; fetch it again and check SHA256SUMS.") from error
