"""YAML and JSON from untrusted sources: whatever is wrong with a text raises one kind of error."""

from __future__ import annotations

import json
import re
from typing import Any

import yaml

DEEPEST = 100  # brackets in brackets; the reader takes time with the square of their number
MOST_VALUES = 10_000_000  # what a text of a few lines can stand for has no bound, as aliases may hold aliases


def parse_yaml(text: str, loader: type[yaml.SafeLoader] = yaml.SafeLoader) -> Any:
    """Return plain data, as the safe loader creates nothing else.

    Raises:
        yaml.YAMLError: the text is not valid, or its aliases expand to more than :data:`MOST_VALUES` values.
    """
    depth = 0
    for bracket in re.finditer(r"[\[\]{}]", text):
        depth += 1 if bracket[0] in "[{" else -1
        if depth > DEEPEST:
            raise yaml.YAMLError("it is nested too deeply")
    try:
        content = yaml.load(text, Loader=loader)
        if _size(content, {}) > MOST_VALUES:
            raise yaml.YAMLError(f"its aliases expand to more than {MOST_VALUES} values")
    except (ValueError, TypeError, LookupError, AttributeError, OverflowError) as error:
        raise yaml.YAMLError(f"a value does not fit its type: {str(error)[:200]}") from error
    except RecursionError as error:
        raise yaml.YAMLError("it is nested too deeply, or contains itself") from error
    return content


def parse_json(text: str | bytes) -> Any:
    """Return plain data.

    Raises:
        ValueError: the text is not valid.
    """
    try:
        return json.loads(text)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error


def _size(content: Any, known: dict[int, int]) -> int:
    """Return the number of values with all aliases expanded; recursive content exceeds the recursion limit."""
    if not isinstance(content, dict | list | tuple | set):
        return 1
    if id(content) not in known:
        parts = [*content.keys(), *content.values()] if isinstance(content, dict) else content
        known[id(content)] = 1 + sum(_size(part, known) for part in parts)
    return known[id(content)]
