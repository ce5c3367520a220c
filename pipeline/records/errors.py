"""The one exception whose message is meant for the user, and what it says of refused values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pydantic import ValidationError


class UserError(Exception):
    """A problem that the user can fix; the message is one sentence: what, where, and how to fix it."""


def first_mistake(error: ValidationError, kind: str = "parameter") -> str:
    """Return where the first refused value is and what is wrong with it, such as ``seed: Input should be ...``.

    Args:
        kind: what unknown names would be, in the reader's words.
    """
    first = error.errors()[0]
    where = ".".join(str(part) for part in first["loc"])
    unknown = first["type"] == "extra_forbidden"
    text = f"unknown {kind} (misspelt?)" if unknown else first["msg"].removeprefix("Value error, ")
    return (f"{where}: {text}" if where else text) + ("" if _says_how(dict(first)) else "; correct it there")


def _says_how(mistake: Mapping[str, Any]) -> bool:
    """Return whether a mistake is one of our own validators', whose sentences end with how to fix it."""
    return mistake["type"] == "value_error"
