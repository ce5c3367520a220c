"""Names that the user gives of what ``params.yaml`` lists."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from pipeline.records import paths
from pipeline.records.errors import UserError


def require_name(
    name: str, known: Collection[str], *sections: str, kind: str = "object", source: Path = paths.PARAMETERS_FILE
) -> None:
    """Check that a name is known.

    Args:
        known: names that stand under ``sections`` in ``source``.
        kind: what they are names of.

    Raises:
        UserError: it is not.
    """
    if name not in known:
        raise UserError(
            f"{source}: there is no {kind} {name!r} under {' or '.join(f'`{section}`' for section in sections)}; add "
            f"it there, or use one of {', '.join(sorted(known)) or 'none yet'}."
        )
