"""What became of the objects that come from packages: ``data/prepare/catalogue.csv``, one row each.

Written by the stage prepare. Later stages take from it which objects are grasped in which style.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path

from pipeline.records.errors import UserError

COLUMNS = {
    "name": "of the object",
    "source": "under assets in params.yaml",
    "path": "of the mesh in its package",
    "outcome": "prepared or refused",
    "reason": "why it was refused",
    "styles": "in which it is grasped",
    "width_mm": "smallest horizontal width",
    "depth_mm": "horizontal extent across that width",
    "height_mm": "vertical extent",
    "mass_g": "",
    "pose_probability": "that the solid comes to rest in this pose; empty where `up` is given",
    "convex_parts": "of the collision shape",
    "repairs": "of the mesh",
    "licence": "of the mesh",
}
MEND = "run `dvc repro prepare`"
PREPARED, REFUSED = "prepared", "refused"


def catalogue_text(rows: Iterable[Mapping[str, object]]) -> str:
    """Return rows as CSV."""
    target = io.StringIO()
    writer = csv.DictWriter(target, list(COLUMNS), lineterminator="\n", restval="")
    writer.writeheader()
    writer.writerows(rows)
    return target.getvalue()


def read_catalogue(file: Path) -> list[dict[str, str]]:
    """Return the rows.

    Raises:
        UserError: the file is missing or damaged.
    """
    try:
        return catalogue_rows(file.read_bytes(), str(file))
    except FileNotFoundError as error:
        raise UserError(f"{file} is missing; {MEND}.") from error


def catalogue_rows(content: bytes, where: str) -> list[dict[str, str]]:
    """Return the rows in the content of a catalogue.

    Args:
        where: names it in the error message.

    Raises:
        UserError: it is damaged.
    """
    try:
        rows = list(csv.DictReader(io.StringIO(content.decode("utf-8"), newline="")))
    except (ValueError, csv.Error) as error:
        raise UserError(f"{where} is damaged ({error}); delete it and {MEND}.") from error
    if any(set(row) != set(COLUMNS) or None in row.values() for row in rows):
        raise UserError(f"{where} is damaged (it lacks columns); delete it and {MEND}.")
    return rows


def styles_of_assets(rows: Iterable[Mapping[str, str]], sources: Collection[str]) -> dict[str, list[str]]:
    """Return the objects of some sources by style, in the order of the catalogue."""
    found: dict[str, list[str]] = {}
    for row in rows:
        for style in row["styles"].split() if row["source"] in sources else ():
            found.setdefault(style, []).append(row["name"])
    return found
