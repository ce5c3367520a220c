"""Reconstruct objects from photos: ``data/reconstruct/<capture>/``.

`python -m pipeline.reconstruct` brings all captures of params.yaml up to date, `--capture demo` reconstructs one by
hand.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.records import paths
from pipeline.records.captures import read_capture, read_truth
from pipeline.records.digests import digest, folder_digest
from pipeline.records.parameters import load_with_workers
from pipeline.records.parameters.names import require_name
from pipeline.stages.code import own_fingerprint
from pipeline.stages.items import Keep, Stage, fingerprints_of, make_by_hand, make_items, one_by_one
from pipeline.stages.outputs import Folders, files_in
from pipeline.stages.running import run_stage

if TYPE_CHECKING:
    from pipeline.compute.fan_out import Workers
    from pipeline.compute.pool import Work
    from pipeline.records.parameters.reconstruct import ReconstructParameters

STAGE = Stage("reconstruct", "captures", Folders(paths.reconstruction_folder("")))


def sections() -> list[str]:
    """Return the sections of ``params.yaml`` that the stage depends on."""
    return ["seed", "captures", "reconstruct"]


def reconstruct(only: str) -> None:
    """Reconstruct the captures that are not up to date, or one by hand.

    Raises:
        UserError: a capture is missing or damaged, or its photos cannot be reconstructed.
    """
    parameters, workers = load_with_workers(sections())
    seed, settings = parameters["seed"], parameters["reconstruct"]
    folders = {name: Path(item.folder) for name, item in parameters["captures"].items()}
    if only:
        require_name(only, folders, "captures", kind="capture")
    names = [only] if only else list(folders)

    def work(name: str, keep: Keep) -> Work[None]:
        keep(name, _files(folders[name], settings, seed, workers))
        yield from ()

    if only:
        make_by_hand(STAGE, names, one_by_one(work), workers)
        return
    common = digest(own_fingerprint("reconstruct"), seed, settings)

    def fingerprint(name: str) -> str:
        read_capture(folders[name])  # what is wrong with a folder is known before the long work on others
        return digest(common, folder_digest(folders[name], "capture"))

    fingerprints, refused = fingerprints_of(names, fingerprint)
    make_items(STAGE, fingerprints, one_by_one(work), workers, refused)


def _files(folder: Path, settings: ReconstructParameters, seed: int, workers: Workers) -> dict[str, bytes]:
    """Return the files of a reconstruction by relative path."""
    from tempfile import TemporaryDirectory

    from pipeline.reconstruct.picture import pictures_of
    from pipeline.reconstruct.reconstruction import cameras_of, metrics_of, reconstruct, true_surfaces
    from pipeline.records.reconstructions import write_reconstruction

    capture, truth = read_capture(folder), read_truth(folder)
    true_surfaces(truth)  # a damaged one is refused before the long work
    result = reconstruct(capture, settings, seed, workers)
    metrics = metrics_of(result, settings.method, truth)
    pictures = pictures_of(capture, result.cameras.views, result.views, result.dense)
    with TemporaryDirectory() as temporary:
        target = Path(temporary) / "reconstruction"
        write_reconstruction(target, result.objects, cameras_of(result.views), metrics, pictures)
        return files_in(target)


def main() -> int:
    """Parse the command line and run the stage."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline.reconstruct", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--capture", default="", help="name under `captures` in params.yaml")
    chosen = parser.parse_args()
    return run_stage("reconstruct", lambda: reconstruct(chosen.capture))


if __name__ == "__main__":
    raise SystemExit(main())
