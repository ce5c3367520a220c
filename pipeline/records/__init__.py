"""Table schemas, typed parameters, paths and errors: the only room that knows file layouts."""

from __future__ import annotations

from typing import Any


def __getattr__(name: str) -> Any:
    """Give users ``pipeline.records.load_grasps``; see :func:`pipeline.share.grasps.load_grasps`."""
    if name == "load_grasps":
        from importlib import import_module

        # No stage asks for it: named relatively, so that it does not count among the code that stages depend on.
        return import_module("..share.grasps", __name__).load_grasps
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
