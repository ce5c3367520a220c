"""The film of one successful trial, with which the report opens: ``reports/film``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pipeline.records.errors import UserError
from pipeline.records.texts import parse_json
from pipeline.records.writing import write_json

FOLDER = Path("reports/film")
VIDEO = "trial.mp4"
_ABOUT = "trial.json"


@dataclass(frozen=True)
class OpeningFilm:
    """A film, and the trial that it shows."""

    source: str  # where its grasp came from
    objects: tuple[str, ...]  # in the order of picking
    trial: int
    video: bytes  # mp4


def write_about(folder: Path, shown: tuple[str, tuple[str, ...], int] | None) -> None:
    """Write which trial a folder's film shows: its source, objects and number; None where none succeeded."""
    about = {} if shown is None else dict(zip(("source", "objects", "trial"), shown, strict=True))
    write_json(folder / _ABOUT, about)


def load_film(folder: Path) -> OpeningFilm | None:
    """Return the film in a folder; None where no trial succeeded.

    Raises:
        UserError: it is missing or damaged.
    """
    about = folder / _ABOUT
    mend = "delete the folder and run `dvc repro report`"
    try:
        shown = parse_json(about.read_text())
        if shown == {}:
            return None
        objects = tuple(str(name) for name in shown["objects"])
        return OpeningFilm(str(shown["source"]), objects, int(shown["trial"]), (folder / VIDEO).read_bytes())
    except FileNotFoundError as error:
        raise UserError(f"{error.filename} is missing; {mend}.") from error
    except (ValueError, KeyError, TypeError) as error:
        raise UserError(f"{about} names no trial; {mend}.") from error
