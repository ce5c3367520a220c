"""Prepare objects, of packages or of the user's own meshes: ``data/prepare/<object>/``.

`python -m pipeline.prepare` brings all objects of params.yaml up to date, `--object cube` prepares one by hand.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.compute.pool import Calls, Work
from pipeline.prepare.catalogue import RECORD, PreparedFolders, record, row_of, totals
from pipeline.records import paths
from pipeline.records.assets import asset_meshes
from pipeline.records.catalogue import read_catalogue
from pipeline.records.digests import digest, file_digest
from pipeline.records.errors import UserError
from pipeline.records.packages import files_beside
from pipeline.records.parameters import load_with_workers
from pipeline.records.parameters.names import require_name
from pipeline.records.parameters.objects import AssetMesh, MeshParameters
from pipeline.stages.code import own_fingerprint
from pipeline.stages.items import Keep, Stage, fingerprints_of, make_by_hand, make_items
from pipeline.stages.outputs import files_in
from pipeline.stages.running import run_stage

if TYPE_CHECKING:
    from pipeline.prepare.sources import RawMesh, Shape
    from pipeline.records.objects import PreparedObject
    from pipeline.records.parameters.prepare import PrepareParameters

STAGE = Stage("prepare", "objects", PreparedFolders(paths.prepared_folder("").parent / "prepare"))


def sections() -> list[str]:
    """Return the sections of ``params.yaml`` that the stage depends on."""
    return ["prepare", "objects", "meshes", "assets"]


def prepare(only: str) -> None:
    """Prepare the objects of params.yaml that are not up to date, or one by hand."""
    parameters, workers = load_with_workers(sections())
    packaged = asset_meshes(parameters["assets"])
    shapes: dict[str, Shape] = {**parameters["objects"], **parameters["meshes"], **packaged}
    if only:
        require_name(only, shapes, "objects", "meshes", "assets")
    from pipeline.prepare.sources import check_source

    if only:
        check_source(shapes[only], only)
    begin = partial(_begin, shapes, parameters["prepare"])
    if only:
        make_by_hand(STAGE, [only], begin, workers)
        return
    code = own_fingerprint("prepare")

    def fingerprint(name: str) -> str:
        check_source(shapes[name], name)
        return digest(code, name, parameters["prepare"], shapes[name], _digest_of_file(shapes[name]))

    fingerprints, refused = fingerprints_of(shapes, fingerprint)
    make_items(STAGE, fingerprints, begin, workers, refused)
    if packaged:
        print("\n".join(totals(read_catalogue(paths.CATALOGUE_FILE))))


def _digest_of_file(shape: Shape) -> str:
    if not isinstance(shape, MeshParameters | AssetMesh):
        return ""
    own = file_digest(Path(shape.file), "prepare")
    beside = files_beside(Path(shape.file))
    return digest(own, [file_digest(path, "prepare") for path in beside]) if beside else own


def _begin(
    shapes: dict[str, Shape], settings: PrepareParameters, names: Sequence[str], keep: Keep
) -> list[tuple[str, Callable[[], Work[None]]]]:
    return [
        (name, partial(_packaged, name, shape, settings, keep))
        if isinstance(shape := shapes[name], AssetMesh)
        else (name, partial(_work, name, shape, settings, keep))
        for name in names
    ]


def _packaged(name: str, mesh: AssetMesh, settings: PrepareParameters, keep: Keep) -> Work[None]:
    """Prepare an object out of a package; one that is refused has its reason as its result."""
    from pipeline.prepare.sources import raw_mesh

    try:
        raw = raw_mesh(mesh, name)
    except UserError as error:
        keep(name, {RECORD: record(row_of(name, mesh, None, str(error)))})
        return
    (files,) = yield Calls(_prepared_or_refused, [(name, mesh, settings, raw)])
    keep(name, files)


def _prepared_or_refused(task: tuple[str, AssetMesh, PrepareParameters, RawMesh]) -> dict[str, bytes]:
    from pipeline.prepare.preparation import prepare_object

    name, mesh, *_ = task
    try:
        prepared = prepare_object(*task)
    except UserError as error:
        return {RECORD: record(row_of(name, mesh, None, str(error)))}
    return {**_files_of(prepared), RECORD: record(row_of(name, mesh, prepared))}


def _work(name: str, shape: Shape, settings: PrepareParameters, keep: Keep) -> Work[None]:
    from pipeline.prepare.sources import raw_mesh

    # The user's own files are read here: a worker may be on a machine that does not have them.
    raw = raw_mesh(shape, name) if isinstance(shape, MeshParameters) else None
    ((files, facts),) = yield Calls(_prepared, [(name, shape, settings, raw)])
    keep(name, files)
    for repair in facts["repairs"]:
        print(f"{name}: {repair}")
    if "guessed_unit" in facts:
        unit, longest = facts["guessed_unit"], facts["longest_extent_in_file"]
        print(
            f"warning: meshes.{name}: the longest extent in the file is {longest:.4g}, taken as {unit}; confirm it "
            f"with `unit: {unit}`, or name the right unit.",
            file=sys.stderr,
        )


def _prepared(
    task: tuple[str, Shape, PrepareParameters, RawMesh | None],
) -> tuple[dict[str, bytes], dict[str, Any]]:
    """Return the files of a prepared object by name, and its provenance."""
    from pipeline.prepare.preparation import prepare_object

    prepared = prepare_object(*task)
    return _files_of(prepared), prepared.provenance


def _files_of(prepared: PreparedObject) -> dict[str, bytes]:
    from tempfile import TemporaryDirectory

    from pipeline.prepare.portrait import portrait
    from pipeline.records.objects import write_prepared_object

    with TemporaryDirectory() as folder:
        write_prepared_object(Path(folder) / prepared.name, prepared, portrait(prepared))
        return files_in(Path(folder) / prepared.name)


def main() -> int:
    """Parse the command line and run the stage."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline.prepare", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--object", default="", help="an object of params.yaml")
    chosen = parser.parse_args()
    return run_stage("prepare", lambda: prepare(chosen.object))


if __name__ == "__main__":
    raise SystemExit(main())
