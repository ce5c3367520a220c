"""Which hands are described in the folder ``hands``, and which of them picks more than one object."""

from __future__ import annotations

from pathlib import Path

from pipeline.records.errors import UserError

HANDS_FOLDER = Path(__file__).resolve().parents[2] / "hands"
DESCRIPTION = "hand.yaml"
ALLEGRO = "allegro"  # the hand of everything about two objects, the arm and the learned model
ALLEGRO_JOINTS = 16
ARM_JOINTS = 7  # of the Panda, which carries it


def known_hands() -> list[str]:
    """Return the names of the hands that are described."""
    return sorted(file.parent.name for file in HANDS_FOLDER.glob(f"*/{DESCRIPTION}"))


def description_file(name: str) -> Path:
    """Return the file that describes a hand.

    Raises:
        UserError: there is none of this name.
    """
    if name not in known_hands():
        raise UserError(
            f"there is no hand {name!r}; describe it in hands/{name}/{DESCRIPTION}, or use one of "
            f"{', '.join(known_hands())}."
        )
    return HANDS_FOLDER / name / DESCRIPTION
