"""The parameters of a run as rows of a table, with what each means."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel

from pipeline.records.parameters import Parameters

Row = tuple[str, str, str]  # dotted name, value, meaning


def section_rows(name: str, value: Any) -> Iterator[Row]:
    """Return the rows of one section of ``params.yaml``, such as ``merge`` or ``seed``."""
    field = Parameters.model_fields.get(name)
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
