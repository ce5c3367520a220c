"""How the results of a stage's items lie in its output: in tables, or as folders of files."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.records.reading import read_json
from pipeline.records.tables import arrow_table, write_arrow
from pipeline.records.writing import replace_folder, write_json

if TYPE_CHECKING:
    import pandas as pd

Find = Callable[[str], Path]  # from a name in the output to a file with that content


class Output(Protocol):
    """The output of a stage, made of the results of its items."""

    @property
    def folder(self) -> Path:
        """Where it lies."""

    def files_of(self, key: str, names: Collection[str]) -> list[str]:
        """Return those of the files ``names`` that hold the result of an item; none if it is not there."""

    def read(self, key: str, names: Sequence[str], find: Find) -> Any:
        """Return the result of an item from these files."""

    def write(self, folder: Path, keys: Sequence[str], result: Callable[[str], Any]) -> None:
        """Write the results of items, in this order, into an empty folder."""

    def place(self, made: Path, target: Path) -> None:
        """Move what :meth:`write` made of some items to its place in the output, beside other items."""


@dataclass(frozen=True)
class Tables:
    """One table for all items whose keys begin alike: ``cube/soup_can`` stands for rows of ``cube.parquet``.

    The result of an item is a ``pyarrow.Table``. The same rows give the same bytes, whether they were computed just now
    or come from an earlier table.
    """

    folder: Path
    schema: pa.Schema
    columns: tuple[str, ...] = ()  # which hold the parts of a row's key, lists part by part; maybe not the table's name

    def rows(self, frame: pd.DataFrame) -> pa.Table:
        """Return a frame as the result of an item."""
        return arrow_table(frame, self.schema)

    def files_of(self, key: str, names: Collection[str]) -> list[str]:
        """Return the table that an item belongs to."""
        name = _table_of(key)
        return [name] if name in names else []

    def read(self, key: str, names: Sequence[str], find: Find) -> pa.Table:
        """Return the rows of an item."""
        groups = _groups(find(names[0]), self.columns)
        parts = tuple(key.split("/"))
        rows = groups.get(parts, groups.get(parts[1:]))
        return self.schema.empty_table() if rows is None else rows.cast(self.schema)

    def write(self, folder: Path, keys: Sequence[str], result: Callable[[str], pa.Table]) -> None:
        """Write one table for each beginning of the keys."""
        members: dict[str, list[str]] = {}
        for key in keys:
            members.setdefault(_table_of(key), []).append(key)
        for name, own in members.items():
            write_arrow(folder / name, pa.concat_tables([result(key) for key in own]))

    def place(self, made: Path, target: Path) -> None:
        """Move a table to its place."""
        os.replace(made, target)


def _table_of(key: str) -> str:
    return f"{key.split('/')[0]}.parquet"


@lru_cache(maxsize=1)  # items of one table are read one after the other
def _groups(source: Path, columns: tuple[str, ...]) -> dict[tuple[str, ...], pa.Table]:
    """Return the rows of a table by the parts of their keys."""
    table = pq.read_table(source)
    if not columns:
        return {(): table}
    places: dict[tuple[str, ...], list[int]] = {}
    values = [table.column(name).to_pylist() for name in columns]
    for place, row in enumerate(zip(*values, strict=True)):
        parts = tuple(str(part) for value in row for part in (value if isinstance(value, list) else [value]))
        places.setdefault(parts, []).append(place)
    return {group: table.take(pa.array(own)) for group, own in places.items()}


@dataclass(frozen=True)
class TablesWithFigures(Tables):
    """Tables, and a JSON file of figures on every item; the result of an item is a pair of both."""

    figures: str = "quality.json"

    def files_of(self, key: str, names: Collection[str]) -> list[str]:
        """Return the table that an item belongs to and the file of figures."""
        own = super().files_of(key, names)
        return [*own, self.figures] if own and self.figures in names else []

    def read(self, key: str, names: Sequence[str], find: Find) -> tuple[pa.Table, Any]:
        """Return rows and figures of an item."""
        first, second = key.split("/")
        figures = read_json(find(self.figures), "run the stage again")
        return super().read(key, names[:1], find), figures[first][second]

    def write(self, folder: Path, keys: Sequence[str], result: Callable[[str], tuple[pa.Table, Any]]) -> None:
        """Write the tables, and the figures by the parts of the keys."""
        figures: dict[str, dict[str, Any]] = {}

        def rows(key: str) -> pa.Table:
            first, second = key.split("/")
            table, figures.setdefault(first, {})[second] = result(key)
            return table

        super().write(folder, keys, rows)  # type: ignore[arg-type]
        write_json(folder / self.figures, figures)

    def place(self, made: Path, target: Path) -> None:
        """Move a table to its place, or add figures to those that are there."""
        if made.name == self.figures and target.exists():
            write_json(target, read_json(target, "run the stage again") | read_json(made, "run this again"))
        else:
            os.replace(made, target)


@dataclass(frozen=True)
class Folders:
    """A folder of files for each item; its result is their content by relative path.

    The key ``""`` stands for an output that is the folder of its only item.
    """

    folder: Path

    def files_of(self, key: str, names: Collection[str]) -> list[str]:
        """Return the files in the folder of an item."""
        return [name for name in names if not key or name.startswith(f"{key}/")]

    def read(self, key: str, names: Sequence[str], find: Find) -> dict[str, bytes]:
        """Return the files of an item."""
        return {name.removeprefix(f"{key}/") if key else name: find(name).read_bytes() for name in names}

    def write(self, folder: Path, keys: Sequence[str], result: Callable[[str], dict[str, bytes]]) -> None:
        """Write the folder of every item."""
        for key in keys:
            write_files(folder / key, result(key))

    def place(self, made: Path, target: Path) -> None:
        """Move the folder of an item to its place."""
        replace_folder(made, target)


def files_in(folder: Path) -> dict[str, bytes]:
    """Return the content of all files below a folder by relative path: the result of an item of :class:`Folders`."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()
    }


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files by relative path below a folder, as :func:`files_in` returns them."""
    for name, content in files.items():
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content)
