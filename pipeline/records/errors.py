"""The one exception whose text is meant for the user."""

from __future__ import annotations


class UserError(Exception):
    """Something the user can mend; the text is one sentence: what, where, and how to mend it."""
