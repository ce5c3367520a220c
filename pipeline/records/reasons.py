"""Why a grasp is rejected or a trial fails: the base of the enumerations that stand beside the tables."""

from __future__ import annotations

from enum import StrEnum
from typing import Self


class Reason(StrEnum):
    """A reason as tables hold it, with one line for readers who have not seen the code.

    Members are written as ``NAME = "value", "meaning"``, in the order in which the checks are made. A table may add a
    detail after a colon, such as ``gravity:+x``.
    """

    meaning: str

    def __new__(cls, value: str, meaning: str) -> Self:
        """Make a member that is its value."""
        member = str.__new__(cls, value)
        member._value_ = value
        member.meaning = meaning
        return member
