"""The parameters of a run as rows of a table, with what each means."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel

from pipeline.records.parameters import Parameters

Row = tuple[str, str, str]  # dotted name, value, meaning


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
    else:
        yield name, value if isinstance(value, str) else json.dumps(value) if value != {} else "none", meaning
