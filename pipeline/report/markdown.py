"""Pieces of Markdown: tables, and prose in lines of equal length."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Sequence

WIDTH = 118  # of prose


def wrapped(markdown: str) -> str:
    """Break the lines of prose anew; headings, tables and code stay."""
    blocks = re.split(r"(```.*?```)", markdown, flags=re.DOTALL)
    for index in range(0, len(blocks), 2):
        paragraphs = blocks[index].split("\n\n")
        filled = [text if text.lstrip().startswith(("|", "#")) else _filled(text) for text in paragraphs]
        blocks[index] = "\n\n".join(filled)
    return "".join(blocks)


def _filled(text: str) -> str:
    end = "\n" if text.endswith("\n") else ""
    begin = "\n" if text.startswith("\n") else ""
    return begin + textwrap.fill(" ".join(text.split()), WIDTH, break_long_words=False, break_on_hyphens=False) + end


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table of figures: all columns but the first are aligned to the right."""
    lines = [header, ["---", *["---:"] * (len(header) - 1)], *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)


def text_table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table of words."""
    return table(header, rows).replace("---:", "---")
