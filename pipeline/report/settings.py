"""The parameters of a run as rows of a table, with what each means."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from markupsafe import Markup
from pydantic import BaseModel

from pipeline.records.parameters import Parameters
from pipeline.report.charts import Table
from pipeline.report.rendering import render

Row = tuple[str, str, str]  # dotted name, value, meaning

MOST_ROWS = 120  # of one section on the page
MOST_LETTERS = 400  # of one value
# Sections that have one row each, and stand in one table.
RUN = ("scale", "preset", "hand", "seed", "pairs")
UNSHOWN = ("compute",)  # no result depends on it


def all_settings(parameters: Parameters) -> dict[str, list[Row]]:
    """Return the rows of every section of ``params.yaml`` on which results depend."""
    fields = Parameters.model_fields.items()
    values = {field.alias or name: getattr(parameters, name) for name, field in fields}
    rows = {name: list(section_rows(name, value)) for name, value in values.items() if name not in UNSHOWN}
    run = [row for name in RUN for row in rows.pop(name)]
    return {"run": run, **rows}


def section_rows(name: str, value: Any) -> Iterator[Row]:
    """Return the rows of one section of ``params.yaml``, such as ``merge`` or ``seed``."""
    field = Parameters.model_fields.get(name)  # none for `validate`, which has no description either
    return described(name, value, (field.description if field else None) or "")


def described(name: str, value: Any, meaning: str = "") -> Iterator[Row]:
    """Return one row per value; fields that params.yaml does not state, as they do not apply, are left out."""
    if isinstance(value, BaseModel):
        for key, field in type(value).model_fields.items():
            if key in value.model_fields_set:
                yield from described(f"{name}.{field.alias or key}", getattr(value, key), field.description or "")
    elif isinstance(value, Mapping) and value:
        for key, item in value.items():
            yield from described(f"{name}.{key}", item, meaning)
    elif isinstance(value, tuple) and any(isinstance(item, BaseModel) for item in value):
        for number, item in enumerate(value):
            yield from described(f"{name}.{number}", item, meaning)
    else:
        yield name, value if isinstance(value, str) else json.dumps(value) if value != {} else "none", meaning


def settings_section(settings: Mapping[str, Sequence[Row]]) -> Markup:
    """Return all parameters, one table to open per section of ``params.yaml``."""
    tables = {
        section: Table(["parameter", "value", "meaning"], shortened(section, rows))
        for section, rows in settings.items()
    }
    return render("settings.html", tables=tables)


def shortened(section: str, rows: Sequence[Row]) -> list[Row]:
    """Return rows and values as far as a page can show them; params.yaml has them all."""
    shown = [
        (name, value if len(value) <= MOST_LETTERS else f"{value[:MOST_LETTERS]} … ({len(value)} letters)", meaning)
        for name, value, meaning in rows[:MOST_ROWS]
    ]
    left = len(rows) - len(shown)
    return [*shown, (section, f"… {left} more values", "In params.yaml.")] if left else shown
