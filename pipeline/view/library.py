"""Reads what is looked at, each file when it is first needed and again when it has changed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd

from pipeline.hand.model import Hand
from pipeline.records import paths
from pipeline.records.captures import read_truth
from pipeline.records.errors import UserError
from pipeline.records.flat import read_flat
from pipeline.records.geometry import read_geometry_file
from pipeline.records.objects import PreparedObject, load_prepared_object
from pipeline.records.parameters import Parameters
from pipeline.records.reconstructions import (
    ReconstructedObject,
    load_reconstructed_object,
    load_reconstruction_metrics,
)
from pipeline.view.rows import FAILURE, INDEX, PASSED, REJECTED, SUCCESS
from pipeline.view.tables import MERGED_VIEW, TRIALS_VIEW, Table, known_tables

Read = TypeVar("Read")


class Library:
    """Everything under ``data/`` that params.yaml names."""

    def __init__(self, parameters: Parameters, hand: Hand) -> None:
        """Look at what is made with ``parameters``; ``hand`` is the one that they name."""
        self.parameters, self.hand = parameters, hand
        self.tables = {table.name: table for table in known_tables(parameters, hand)}
        self._kept: dict[tuple[str, str], tuple[Any, Any]] = {}

    def _once(self, kind: str, file: Path, read: Callable[[], Read]) -> Read:
        """Return what ``read`` returned for ``file`` as it is now."""
        try:
            about = file.stat()
            stamp = (about.st_mtime_ns, about.st_size, about.st_ino)
        except OSError:
            stamp = None
        before, value = self._kept.get((kind, str(file)), (None, None))
        if stamp is None or before != stamp:
            value = read()
            self._kept[kind, str(file)] = (stamp, value)
        return value  # type: ignore[no-any-return]

    def index(self, view: str) -> tuple[pd.DataFrame, list[str]]:
        """Return one line per row of all tables of a view that can be read, and a sentence per table that cannot."""
        lines, sentences = [pd.DataFrame(columns=list(INDEX))], []
        for table in self.tables.values():
            if table.view != view:
                continue
            try:
                lines.append(self._once("index", _marker(table), lambda table=table: _lines(table)))  # type: ignore[misc]
            except UserError as error:
                sentences.append(str(error))
        return pd.concat([part for part in lines if len(part)] or lines, ignore_index=True), sentences

    def row(self, line: pd.Series) -> dict[str, Any]:
        """Return the whole row behind a line of an index; a folder has none but its name.

        Raises:
            UserError: its table is not there any more, or damaged.
        """
        table = self.tables[line["table"]]
        if table.schema is None:
            return {"name": line["name"]}
        schema = table.schema
        rows = self._once("rows", table.file, lambda: read_flat(table.file, schema, table.stage))
        if line["position"] >= len(rows):
            raise UserError(f"{table.file} has changed and has no row {line['number']} any more; choose another row.")
        return {str(column): value for column, value in rows.iloc[line["position"]].items()}

    def prepared(self, name: str) -> PreparedObject:
        """Return a prepared object; see ``records.objects.load_prepared_object``."""
        return self._once("object", paths.prepared_folder(name) / "object.json", lambda: load_prepared_object(name))

    def reconstructed(self, capture: str, name: str) -> ReconstructedObject:
        """Return an object as photos show it; see ``records.reconstructions.load_reconstructed_object``."""
        file = paths.reconstruction_folder(capture) / "objects" / name / "object.json"
        return self._once("photos", file, lambda: load_reconstructed_object(capture, name))

    def metrics(self, capture: str) -> dict[str, Any]:
        """Return how well a reconstruction went; see ``records.reconstructions.load_reconstruction_metrics``."""
        file = paths.reconstruction_folder(capture) / "metrics.json"
        return self._once("metrics", file, lambda: load_reconstruction_metrics(capture))

    def truth(self, capture: str, name: str) -> tuple[Any, Any] | None:
        """Return the true surface of an object of a capture, scene frame: vertices (V, 3) and faces; None without one.

        Raises:
            UserError: the ground truth is damaged.
        """
        known = read_truth(Path(self.parameters.captures[capture].folder))
        source = known.surfaces.get(name) if known else None
        return None if source is None else self._once("truth", source, lambda: _mesh(source))


def _mesh(source: Path) -> tuple[Any, Any]:
    try:
        mesh = read_geometry_file(source)
        return mesh.vertices.astype(float), mesh.faces.astype(int)
    except (ValueError, TypeError, LookupError, EOFError, OSError, AttributeError) as error:
        raise UserError(f"{source} is damaged ({error}); run `dvc repro capture` to make it again.") from error


def _marker(table: Table) -> Path:
    """The file whose change means that the table has changed."""
    return table.file if table.schema is not None else table.file / "object.json"


def _lines(table: Table) -> pd.DataFrame:
    if table.schema is None:
        if not _marker(table).exists():
            raise UserError(f"{table.file} is missing; run `dvc repro {table.stage}` to make it.")
        line = [table.name, table.name, 0, 0, table.source, table.style, table.first, "", "", ""]
        return pd.DataFrame([line], columns=list(INDEX))
    trials, pairs = table.view == TRIALS_VIEW, table.view in (MERGED_VIEW, TRIALS_VIEW)
    wanted = [table.number, *(("reason", "success") if trials else ("rejected_by",))]
    # A table of a thousand objects has long columns that no list needs.
    rows = read_flat(table.file, table.schema, table.stage, [*wanted, *(("object0", "object1") if pairs else ())])
    reasons = rows["reason" if trials else "rejected_by"].fillna("")
    good = rows["success"] if trials else reasons == ""
    first, second = (rows["object0"], rows["object1"]) if pairs else (table.first, "")
    numbers = rows[table.number].astype(int)
    prefix = table.name + "/" + (first + "/" if not table.first else "") + (second + "/" if pairs else "")
    success, failure = (SUCCESS, FAILURE) if trials else (PASSED, REJECTED)
    return pd.DataFrame(
        {
            "name": prefix + numbers.astype(str),
            "table": table.name,
            "position": range(len(rows)),
            "number": numbers,
            "source": table.source,
            "style": table.style,
            "first": first,
            "second": second,
            "reason": reasons.where(reasons != "", success),
            "outcome": good.map({True: success, False: failure}),
        },
        columns=list(INDEX),
    )
