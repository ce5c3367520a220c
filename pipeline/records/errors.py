"""The one exception whose message is meant for the user, and what it says of refused values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
    return _mistake(dict(error.errors()[0]), kind)


def _mistake(mistake: Mapping[str, Any], kind: str) -> str:
    where = ".".join(str(part) for part in mistake["loc"])
    unknown = mistake["type"] == "extra_forbidden"
    text = f"unknown {kind} (misspelt?)" if unknown else mistake["msg"].removeprefix("Value error, ")
    return (f"{where}: {text}" if where else text) + ("" if _says_how(mistake) else "; correct it there")


def all_mistakes(error: ValidationError, kind: str) -> list[str]:
    """Return what :func:`first_mistake` says, of every refused value."""
    return [_mistake(dict(one), kind) for one in error.errors()]


def one_sentence(where: object, mistakes: Sequence[str]) -> str:
    """Return what is wrong with a file: the only mistake, or all of them, numbered, in one line."""
    if len(mistakes) == 1:
        return f"{where}: {mistakes[0]}."
    listed = "; ".join(f"({number}) {mistake}" for number, mistake in enumerate(mistakes, start=1))
    return f"{where} has {len(mistakes)} mistakes: {listed}."


def _says_how(mistake: Mapping[str, Any]) -> bool:
    """Return whether a mistake is one of our own validators', whose sentences end with how to fix it."""
    return mistake["type"] == "value_error"
