"""Prepare objects, of the packages or of the user's own meshes: ``data/prepare/<object>/``.

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
from pipeline.records import paths
from pipeline.records.digests import digest, file_digest
from pipeline.records.packages import files_beside
from pipeline.records.parameters import load_with_workers
from pipeline.records.parameters.names import require_name
from pipeline.records.parameters.objects import MeshParameters, ObjectParameters
from pipeline.stages.code import own_fingerprint
from pipeline.stages.items import Keep, Stage, fingerprints_of, make_by_hand, make_items
from pipeline.stages.outputs import Folders, files_in
from pipeline.stages.running import run_stage

if TYPE_CHECKING:
    from pipeline.prepare.sources import RawMesh
    from pipeline.records.parameters.prepare import PrepareParameters

Shape = ObjectParameters | MeshParameters
STAGE = Stage("prepare", "objects", Folders(paths.prepared_folder("").parent / "prepare"))


def sections() -> list[str]:
    """Return the sections of ``params.yaml`` that the stage depends on."""
    return ["prepare", "objects", "meshes"]


def prepare(only: str) -> None:
    """Prepare the objects of params.yaml that are not up to date, or one by hand."""
    parameters, workers = load_with_workers(sections())
    shapes: dict[str, Shape] = {**parameters["objects"], **parameters["meshes"]}
    if only:
        require_name(only, shapes, "objects", "meshes")
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


def _digest_of_file(shape: Shape) -> str:
    if not isinstance(shape, MeshParameters):
        return ""
    own = file_digest(Path(shape.file), "prepare")
    beside = files_beside(Path(shape.file))
    return digest(own, [file_digest(path, "prepare") for path in beside]) if beside else own


def _begin(
    shapes: dict[str, Shape], settings: PrepareParameters, names: Sequence[str], keep: Keep
) -> list[tuple[str, Callable[[], Work[None]]]]:
    return [(name, partial(_work, name, shapes[name], settings, keep)) for name in names]


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
    from tempfile import TemporaryDirectory

    from pipeline.prepare.portrait import portrait
    from pipeline.prepare.preparation import prepare_object
    from pipeline.records.objects import write_prepared_object

    prepared = prepare_object(*task)
    with TemporaryDirectory() as folder:
        write_prepared_object(Path(folder) / prepared.name, prepared, portrait(prepared))
        return files_in(Path(folder) / prepared.name), prepared.provenance


def main() -> int:
    """Parse the command line and run the stage."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline.prepare", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--object", default="", help="a name under objects or meshes in params.yaml")
    chosen = parser.parse_args()
    return run_stage("prepare", lambda: prepare(chosen.object))


if __name__ == "__main__":
    raise SystemExit(main())
