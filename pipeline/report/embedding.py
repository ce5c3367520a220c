"""Data inside the page that nothing reads until it is wanted: compressed, and inert to the browser."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class FoldedTable:
    """A table that the page makes when its fold is opened."""

    headers: Sequence[str]
    rows: Sequence[Sequence[str]]


def compressed(value: Any) -> str:
    """Return ``value`` as JSON, gzip and base64; ``folds.js`` reads it."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"))
    return base64.b64encode(gzip.compress(text.encode(), compresslevel=9, mtime=0)).decode()


def compressed_tables(tables: Mapping[str, FoldedTable]) -> str:
    """Return the rows of all ``tables`` by id, compressed; equal headers are stored once."""
    kinds = list(dict.fromkeys(tuple(one.headers) for one in tables.values()))
    rows = {key: [kinds.index(tuple(one.headers)), one.rows] for key, one in tables.items()}
    return compressed({"headers": kinds, "tables": rows})
