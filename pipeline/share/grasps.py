"""The data set of two-object grasps as one pandas table."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

import pandas as pd

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.flat import PAIR_GRASPS
from pipeline.records.sources import OF_ALL_PAIRS, SOURCES
from pipeline.share.project import Project, objects_of, open_project, partners_of, read_pairs, tried_firsts
from pipeline.share.publication import is_publication, published_tables


def load_grasps(
    repository: str | os.PathLike[str] = ".",
    rev: str | None = None,
    *,
    first: str | Iterable[str] | None = None,
    second: str | Iterable[str] | None = None,
    source: str | Iterable[str] = "synthesized",
    only_accepted: bool = True,
) -> pd.DataFrame:
    """Return two-object grasps, one per row, with the columns of :data:`pipeline.share.GRASP_COLUMNS`.

    Vectors are numpy arrays: ``np.stack(grasps["q"])`` is (grasps, 16). Lengths are metres, angles radians, quaternions
    w, x, y, z. The hand frame is the Allegro's ``base_link`` (palm normal +x, fingers +z, index finger on the side of
    +y); an object's frame has its origin at the centre of mass, z up as the object stands.

    Args:
        repository: the folder of a clone, whose files are read as they are; or a git address (or bare repository),
            from which only the chosen tables are fetched, through its DVC remote; or a folder of
            `./dev publish-dataset`, which holds accepted grasps only.
        rev: branch, tag or commit; then data come from DVC's cache or remote, for a folder too.
        first, second: object or objects picked first (held by thumb, index and middle finger) and second (by ring
            finger and palm); all when left out.
        source: one or more of ``records.sources.OF_ALL_PAIRS``, such as ``learned``.
        only_accepted: leave out what a check rejected; otherwise ``rejected_by`` names the first failed check.

    Raises:
        UserError: something is missing or damaged; the sentence says what and how to mend it.
    """
    sources = _among("source", source, tuple(OF_ALL_PAIRS), "this project")
    if rev is None and is_publication(Path(repository)):
        return _published(Path(repository), sources, first, second)
    with open_project(repository, rev) as project:
        return grasps_of(project, pairs_asked_for(project, first, second), sources, only_accepted)


def _published(
    folder: Path, sources: list[str], first: str | Iterable[str] | None, second: str | Iterable[str] | None
) -> pd.DataFrame:
    """Return the grasps of a published folder, as :func:`load_grasps` does."""
    grasps = pd.concat(published_tables(folder, sources), ignore_index=True)
    for column, what, wanted in (("object0", "first", first), ("object1", "second", second)):
        chosen = _among(what, wanted, tuple(dict.fromkeys(grasps[column])), str(folder))
        grasps = grasps[grasps[column].isin(chosen)]
    return grasps.reset_index(drop=True)


def grasps_of(
    project: Project, pairs: Sequence[tuple[str, str]], sources: Iterable[str], only_accepted: bool
) -> pd.DataFrame:
    """Return the grasps of ``pairs``, as :func:`load_grasps` does.

    Raises:
        UserError: a table is missing or damaged, or there is none.
    """
    seconds: dict[str, list[str]] = {}
    for first, second in pairs:
        seconds.setdefault(first, []).append(second)
    tables, tried = [], tried_firsts(project, seconds)
    for source in sources:
        for first, own in seconds.items():
            if not SOURCES[source].of_single_grasps and first not in tried:
                continue
            table, stage = SOURCES[source].table(first), SOURCES[source].stage
            for rows in read_pairs(project, table, PAIR_GRASPS, stage, own).values():
                kept = rows[rows["rejected_by"] == ""] if only_accepted else rows
                kept.insert(0, "source", source)
                tables.append(kept)
    if not tables:
        raise UserError("these pairs were merged for the training alone; ask for the source synthesized.")
    return pd.concat(tables, ignore_index=True)


def pairs_asked_for(
    project: Project, first: str | Iterable[str] | None = None, second: str | Iterable[str] | None = None
) -> list[tuple[str, str]]:
    """Return the pairs of the project's params.yaml that were asked for, in its order.

    Raises:
        UserError: there is no such object, or no pair at all.
    """
    objects, partners = objects_of(project), partners_of(project)
    place = project.where(paths.PARAMETERS_FILE)
    firsts = _among("first", first, objects["pinch"], place)
    seconds = _among("second", second, objects["side"], place)
    pairs = [(one, other) for one in firsts for other in partners[one] if other in seconds]
    if not pairs:
        raise UserError(f"{place} names no such pair of objects; see `styles` and `pairs` there.")
    return pairs


def _among(what: str, wanted: str | Iterable[str] | None, known: Sequence[str], place: str) -> list[str]:
    chosen = list(known) if wanted is None else [wanted] if isinstance(wanted, str) else list(wanted)
    for name in chosen:
        if name not in known:
            raise UserError(f"{place} has no {what} {name!r}; choose among {', '.join(known) or 'none'}.")
    return [name for name in known if name in chosen]
