"""The parameters of a run as rows of a table, with what each means."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel

Row = tuple[str, str, str]  # dotted name, value, meaning


def described(name: str, value: Any, meaning: str = "") -> Iterator[Row]:
    """Return one row per value of a section of ``params.yaml``; values that do not apply (not stated) are left out."""
    if isinstance(value, BaseModel):
        for key, field in type(value).model_fields.items():
            if key in value.model_fields_set:
                yield from described(f"{name}.{field.alias or key}", getattr(value, key), field.description or "")
    elif isinstance(value, Mapping) and value:
        for key, item in value.items():
            yield from described(f"{name}.{key}", item, meaning)
    else:
        yield name, value if isinstance(value, str) else json.dumps(value), meaning
