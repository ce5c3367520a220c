"""What the record is made of: parsing of the files of a result, wherever their bytes come from."""

from __future__ import annotations

import csv
import io
from typing import Any

import yaml

from pipeline.records.texts import parse_json, parse_yaml

# The parser in C reads the lock of many stages ten times faster.
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def mapping_of_json(text: str | bytes) -> dict[str, Any]:
    """Return the content of a JSON file that holds a mapping.

    Raises:
        ValueError: it does not.
    """
    content = parse_json(text)
    if not isinstance(content, dict):
        raise ValueError("no mapping")
    return content


def mapping_of_yaml(text: str | bytes) -> dict[str, Any]:
    """Return the content of a YAML file that holds a mapping.

    Raises:
        ValueError: it does not.
    """
    try:
        content = parse_yaml(text if isinstance(text, str) else text.decode(), _LOADER)
    except yaml.YAMLError as error:
        raise ValueError(str(error)) from error
    if not isinstance(content, dict):
        raise ValueError("no mapping")
    return content


def curve_of_csv(text: str) -> list[dict[str, float]]:
    """Return the rows of a training's history.

    Raises:
        ValueError: a cell is missing or no number.
    """
    try:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(io.StringIO(text))]
    except TypeError as error:
        raise ValueError("a row is too short or too long") from error
