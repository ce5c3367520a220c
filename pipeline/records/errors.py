"""The one exception whose message is meant for the user."""

from __future__ import annotations


class UserError(Exception):
    """A problem that the user can fix; the message is one sentence: what, where, and how to fix it."""
