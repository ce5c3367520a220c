"""Render the photos of captures: ``data/capture/<name>/``.

`python -m pipeline.capture` brings all renderings of params.yaml up to date, `--name demo` makes one by hand.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from pipeline.records import paths
from pipeline.records.digests import digest, prepared_digest
from pipeline.records.objects import load_prepared_object
from pipeline.records.parameters import load_with_workers
from pipeline.records.parameters.names import require_name
from pipeline.stages.code import own_fingerprint
from pipeline.stages.items import Keep, Stage, fingerprints_of, make_by_hand, make_items, one_by_one
from pipeline.stages.outputs import Folders
from pipeline.stages.running import run_stage

if TYPE_CHECKING:
    from pipeline.compute.pool import Work

STAGE = Stage("capture", "captures", Folders(paths.capture_folder("")))


def sections() -> list[str]:
    """Return the sections of ``params.yaml`` that the stage depends on."""
    return ["seed", "renderings"]


def capture(only: str) -> None:
    """Render the captures that are not up to date, or one by hand."""
    parameters, workers = load_with_workers(sections())
    renderings, seed = parameters["renderings"], parameters["seed"]
    if only:
        require_name(only, renderings, "renderings", kind="capture")
    names = [only] if only else list(renderings)

    def work(name: str, keep: Keep) -> Work[None]:
        from pipeline.capture.recipe import rendering

        objects = {item: load_prepared_object(item) for item in renderings[name].objects}
        keep(name, (yield from rendering(name, objects, renderings[name], seed)))

    if only:
        make_by_hand(STAGE, names, one_by_one(work), workers)
        return
    common = digest(own_fingerprint("capture"), seed)

    def fingerprint(name: str) -> str:
        return digest(common, name, renderings[name], [prepared_digest(item) for item in renderings[name].objects])

    fingerprints, refused = fingerprints_of(names, fingerprint)
    make_items(STAGE, fingerprints, one_by_one(work), workers, refused)


def main() -> int:
    """Parse the command line and run the stage."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline.capture", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--name", default="", help="name under `renderings` in params.yaml")
    chosen = parser.parse_args()
    return run_stage("capture", lambda: capture(chosen.name))


if __name__ == "__main__":
    raise SystemExit(main())
