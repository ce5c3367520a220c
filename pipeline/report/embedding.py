"""Data inside the page that nothing reads until it is wanted: compressed, and inert to the browser."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any


@dataclass(frozen=True)
class FoldedTable:
    """A table that the page makes when its fold is opened."""

    headers: Sequence[str]
    rows: Sequence[Sequence[str]]


def compressed_block(name: str, value: Any) -> str:
    """Return an element with the id ``name`` that holds ``value`` as JSON, gzip and base64; see ``folds.js``."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"))
    packed = base64.b64encode(gzip.compress(text.encode(), compresslevel=9, mtime=0)).decode()
    return f'<script type="application/octet-stream" id="{escape(name)}">{packed}</script>\n'


def tables_block(name: str, tables: Mapping[str, FoldedTable]) -> str:
    """Return the block with the rows of all ``tables`` by id; equal headers are stored once."""
    kinds = list(dict.fromkeys(tuple(one.headers) for one in tables.values()))
    rows = {key: [kinds.index(tuple(one.headers)), one.rows] for key, one in tables.items()}
    return compressed_block(name, {"headers": kinds, "tables": rows})


def fold(key: str, title: str) -> str:
    """Return the closed fold, with the id ``key``, of a table in :func:`tables_block`."""
    return f'<details class="folded" id="{escape(key)}"><summary>{escape(title)}</summary></details>\n'
