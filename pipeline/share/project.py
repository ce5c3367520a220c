"""Files of a project that has grasps: a working folder, or any revision of a git repository with its DVC remote.

What is read may come from strangers: only YAML and parquet are parsed (neither can execute anything), names are checked
before they become paths, and every table must have the columns of its schema.
"""

from __future__ import annotations

import atexit
import io
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Protocol

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import yaml
from pydantic import TypeAdapter

from pipeline.records import paths
from pipeline.records.catalogue import catalogue_rows, styles_of_assets
from pipeline.records.errors import UserError
from pipeline.records.flat import flat, stored
from pipeline.records.hands import ALLEGRO
from pipeline.records.parameters import OBJECT_NAME
from pipeline.records.parameters.pairs import PairsParameter, is_tried, partners
from pipeline.records.tables import check_size, hand_of_schema
from pipeline.records.texts import parse_yaml

STYLES = ("pinch", "side")


class Project(Protocol):
    """Where files come from."""

    def read(self, path: Path, made_by: str) -> bytes:
        """Return the content of a file, ``path`` relative to the project's root.

        Args:
            made_by: the DVC stage that writes the file, '' for a file that git keeps.

        Raises:
            UserError: it cannot be had.
        """
        ...

    def where(self, path: Path) -> str:
        """Return how errors name the file."""
        ...


@dataclass(frozen=True)
class WorkingFolder:
    """A clone as it lies on disk, whatever it holds."""

    folder: Path

    def where(self, path: Path) -> str:
        """Return how errors name the file."""
        return str(self.folder / path)

    def read(self, path: Path, made_by: str) -> bytes:
        """Return the content of a file; see :class:`Project`."""
        try:
            return (self.folder / path).read_bytes()
        except FileNotFoundError as error:
            mend = (
                f"run `dvc pull {made_by}` there to fetch it, or `dvc repro {made_by}` to compute it"
                if made_by
                else "name the folder of a clone of this project, or the address of its git repository"
            )
            raise UserError(f"{self.where(path)} is missing; {mend}.") from error
        except OSError as error:
            raise UserError(f"cannot read {self.where(path)}: {error.strerror}.") from error


@dataclass(frozen=True)
class PublishedRevision:
    """A revision of a git repository; data come from its DVC remote, or from the cache where it is a local clone."""

    address: str
    rev: str | None
    files: Any  # dvc.api.DVCFileSystem

    def where(self, path: Path) -> str:
        """Return how errors name the file."""
        return f"{path} of {_spoken(self.address, self.rev)}"

    def read(self, path: Path, made_by: str) -> bytes:
        """Return the content of a file; see :class:`Project`."""
        from dvc_data.index import DataIndexDirError

        with _dvc_errors(self.address, self.rev, path):
            try:
                return self.files.read_bytes(path.as_posix())
            except DataIndexDirError as error:  # of a folder's list; its cause is what the storage said
                raise (error.__cause__ or FileNotFoundError()) from error
            except FileNotFoundError as error:
                if made_by:
                    raise
                raise UserError(
                    f"{self.where(path)} is not there, so it is no project of two-object grasps; check the address and "
                    "the revision."
                ) from error


@contextmanager
def open_project(repository: str | os.PathLike[str] = ".", rev: str | None = None) -> Iterator[Project]:
    """Yield where the files of ``repository`` come from.

    Args:
        repository: the folder of a clone, or what `git clone` takes: an address, or a bare repository.
        rev: branch, tag or commit; when left out, the files of a clone as they are, or the default branch.

    Raises:
        UserError: there is no such repository or revision.
    """
    folder = Path(repository)
    if rev is None and folder.is_dir() and not (folder / "HEAD").is_file():
        yield WorkingFolder(folder)
        return
    address = os.fspath(repository)
    with _dvc_errors(address, rev, None):
        from dvc.api import DVCFileSystem

        _remove_clones_at_exit()
        files = DVCFileSystem(address, rev=rev)
        files.exists(paths.PARAMETERS_FILE.as_posix())  # clones, and finds the revision
    try:
        yield PublishedRevision(address, rev, files)
    finally:
        files.close()


@cache
def _remove_clones_at_exit() -> None:
    """Have DVC remove its temporary clones when Python ends; until then, another call uses them again."""
    from dvc.repo.open_repo import clean_repos

    atexit.register(clean_repos)


def _spoken(address: str, rev: str | None) -> str:
    return address if rev is None else f"{address} at {rev}"


@contextmanager
def _dvc_errors(address: str, rev: str | None, path: Path | None) -> Iterator[None]:
    """Say in one sentence what DVC and git mean."""
    from dvc.exceptions import FileMissingError, NotDvcRepoError
    from dvc.scm import CloneError, RevError

    place = _spoken(address, rev)
    try:
        yield
    except CloneError as error:
        raise UserError(
            f"there is no git repository at {address} that can be read; check the address and that "
            f"`git ls-remote {address}` works."
        ) from error
    except RevError as error:
        raise UserError(f"{address} has no revision {rev}; name a branch, tag or commit that was pushed.") from error
    except NotDvcRepoError as error:
        raise UserError(f"{place} is no DVC project, so it has no grasps; check the address.") from error
    except (FileNotFoundError, FileMissingError) as error:
        raise UserError(
            f"{path} of {place} cannot be fetched; ask its owner to name a DVC remote in .dvc/config, to commit "
            f"dvc.lock and to run `dvc push`, or choose other grasps or another revision."
        ) from error
    except UserError:
        raise
    except Exception as error:  # plug-ins for storage raise whatever their libraries do
        reason = " ".join(str(error).split()) or type(error).__name__
        what = "the repository" if path is None else path
        raise UserError(f"cannot read {what} of {place}: {reason.rstrip('.')}.") from error


def objects_of(project: Project) -> dict[str, list[str]]:
    """Return the objects of both styles that the project's params.yaml names, in its order.

    Tables of objects that it no longer names may still lie in a working folder; they are no part of the data set.

    Raises:
        UserError: params.yaml is missing, or is none of this project.
    """
    return _objects(project, _parameters(project))


def partners_of(project: Project) -> dict[str, tuple[str, ...]]:
    """Return, for each first object of the project's params.yaml, the objects that are picked after it.

    Raises:
        UserError: params.yaml is missing, or is none of this project or this version.
    """
    content = _parameters(project)
    objects, (pairs, seed) = _objects(project, content), _pairs(project, content)
    return partners(objects["pinch"], objects["side"], pairs, seed)


def tried_firsts(project: Project, firsts: Iterable[str]) -> set[str]:
    """Return those of some first objects whose pairs the project does not merge for the training alone.

    Raises:
        UserError: as :func:`partners_of`.
    """
    pairs, _ = _pairs(project, _parameters(project))
    return {first for first in firsts if is_tried(first, pairs)}


def _pairs(project: Project, parameters: Any) -> tuple[PairsParameter, int]:
    """Return what says which objects are picked together, and the seed."""
    place = project.where(paths.PARAMETERS_FILE)
    if "pairs" not in parameters:
        raise UserError(f"{place} has no `pairs`: another version of this project made it; load it with that version.")
    try:
        pairs: Any = TypeAdapter(PairsParameter).validate_python(parameters["pairs"])
        return pairs, TypeAdapter(int).validate_python(parameters["seed"])
    except (ValueError, KeyError) as error:
        raise UserError(f"{place} says neither by `pairs` nor by `seed` which objects are picked together.") from error


def _parameters(project: Project) -> Any:
    try:
        return parse_yaml(project.read(paths.PARAMETERS_FILE, made_by="").decode())
    except (yaml.YAMLError, ValueError) as error:
        raise _no_project(project) from error


def _objects(project: Project, parameters: Any) -> dict[str, list[str]]:
    try:
        found = {style: list(parameters["styles"][style]) for style in STYLES}
    except (KeyError, TypeError) as error:
        raise _no_project(project) from error
    if parameters.get("assets"):
        catalogue = project.read(paths.CATALOGUE_FILE, made_by="prepare")
        packaged = styles_of_assets(
            catalogue_rows(catalogue, project.where(paths.CATALOGUE_FILE)), list(parameters["assets"])
        )
        found = {style: list(dict.fromkeys([*own, *packaged.get(style, ())])) for style, own in found.items()}
    place = project.where(paths.PARAMETERS_FILE)
    for name in (name for style in STYLES for name in found[style]):
        if not isinstance(name, str) or not OBJECT_NAME.fullmatch(name):
            raise UserError(f"{place} names an object {name!r}; names have small letters, digits and underscores.")
    return found


def _no_project(project: Project) -> UserError:
    place = project.where(paths.PARAMETERS_FILE)
    return UserError(f"{place} does not list objects under `styles`, so it is no project of two-object grasps.")


def read_columns(project: Project, path: Path, columns: pa.Schema, made_by: str) -> pd.DataFrame:
    """Return ``columns`` of a parquet table; other columns are left out.

    Raises:
        UserError: the table is missing or damaged, or lacks a column or has one of another type.
    """
    with _types(project, path):
        return _read(project, path, columns, made_by).to_pandas(ignore_metadata=True)


def read_pairs(
    project: Project, path: Path, columns: pa.Schema, made_by: str, seconds: Sequence[str]
) -> dict[str, pd.DataFrame]:
    """Return the rows of pairs by their second object, from the table of all pairs of one first object.

    Raises:
        UserError: see :func:`read_columns`.
    """
    with _types(project, path):
        table = flat(_read(project, path, stored(columns), made_by), columns)
        own = {second: table.filter(pc.equal(table["object1"], second)) for second in seconds}
        return {second: rows.to_pandas(ignore_metadata=True) for second, rows in own.items()}


def _read(project: Project, path: Path, columns: pa.Schema, made_by: str) -> pa.Table:
    content = project.read(path, made_by)
    try:
        check_size(io.BytesIO(content))
        table = pq.read_table(io.BytesIO(content))
    except (pa.ArrowException, OSError, ValueError) as error:
        raise UserError(f"{project.where(path)} is damaged or no parquet file; fetch or make it again.") from error
    hand = hand_of_schema(table.schema)
    if hand != ALLEGRO:
        raise UserError(
            f"{project.where(path)} holds grasps of the hand {hand}, and only those of the {ALLEGRO} are shared so; "
            "read the file with pandas.read_parquet."
        )
    missing = [name for name in columns.names if name not in table.column_names]
    if missing:
        raise UserError(
            f"{project.where(path)} has no column {missing[0]}: another version of this project made it; load it with "
            "that version."
        )
    return table.select(columns.names).cast(columns)


@contextmanager
def _types(project: Project, path: Path) -> Iterator[None]:
    """Say in one sentence that columns are of other types."""
    try:
        yield
    except (pa.ArrowException, ValueError) as error:
        raise UserError(
            f"{project.where(path)} has columns of other types than this version expects; load it with the version "
            "that made it."
        ) from error
