"""`python -m pipeline.capture --name demo`: render the photos of ``data/capture/<name>/``."""

from __future__ import annotations

import argparse

from pipeline.records import paths
from pipeline.records.parameters import load_parameters, read_parameters
from pipeline.records.running import run_stage


def sections(name: str) -> list[str]:
    """Parameter sections that ``capture@<name>`` declares in ``dvc.yaml``."""
    return ["seed", f"renderings.{name}"]


def capture(name: str) -> None:
    """Render one capture and write its folder."""
    seed, settings = load_parameters(sections(name)).values()
    from pipeline.capture.recipe import render_capture
    from pipeline.records.objects import load_prepared_object

    objects = {object_name: load_prepared_object(object_name) for object_name in settings.objects}
    render_capture(paths.capture_folder(name), name, objects, settings, seed, read_parameters().compute.workers)


def main() -> int:
    """Parse the command line and run the stage."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.capture", description=__doc__)
    parser.add_argument("--name", required=True, help="name under `renderings` in params.yaml")
    chosen = parser.parse_args()
    return run_stage(f"capture@{chosen.name}", lambda: capture(chosen.name))


if __name__ == "__main__":
    raise SystemExit(main())
