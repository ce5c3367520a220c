"""`python -m pipeline.reconstruct --capture demo`: make ``data/reconstruct/<capture>/`` from its photos."""

from __future__ import annotations

import argparse
from pathlib import Path

from pipeline.records import paths
from pipeline.records.captures import read_capture, read_truth
from pipeline.records.parameters import load_parameters, read_parameters
from pipeline.records.running import run_stage
from pipeline.records.writing import check_writable


def sections(capture: str) -> list[str]:
    """Parameter sections that ``reconstruct@<capture>`` declares in ``dvc.yaml``."""
    return ["seed", f"captures.{capture}", "reconstruct"]


def run(name: str) -> None:
    """Reconstruct one capture and write its folder."""
    seed, source, settings = load_parameters(sections(name)).values()
    folder = Path(source.folder)
    capture, truth = read_capture(folder), read_truth(folder)
    from pipeline.reconstruct.picture import pictures_of
    from pipeline.reconstruct.reconstruction import cameras_of, metrics_of, reconstruct, true_surfaces
    from pipeline.records.reconstructions import write_reconstruction

    # What would be told at the end is told before the long work.
    check_writable(paths.reconstruction_folder(name))
    true_surfaces(truth)
    result = reconstruct(capture, settings, seed, read_parameters().compute)
    metrics = metrics_of(result, settings.method, truth)
    pictures = pictures_of(capture, result.sparse.views, result.views, result.dense)
    cameras = cameras_of(result.views)
    write_reconstruction(paths.reconstruction_folder(name), result.objects, cameras, metrics, pictures)


def main() -> int:
    """Parse the command line and run the stage."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.reconstruct", description=__doc__)
    parser.add_argument("--capture", required=True, help="name under `captures` in params.yaml")
    chosen = parser.parse_args()
    return run_stage(f"reconstruct@{chosen.capture}", lambda: run(chosen.capture))


if __name__ == "__main__":
    raise SystemExit(main())
