"""`python -m pipeline.prepare --object cube` or `--mesh mug`: make ``data/prepare/<object>/``."""

from __future__ import annotations

import argparse
import sys

from pipeline.records import paths
from pipeline.records.objects import write_prepared_object
from pipeline.records.parameters import load_parameters
from pipeline.records.running import run_stage
from pipeline.records.writing import check_writable


def sections(object_name: str = "", mesh: str = "") -> list[str]:
    """Parameter sections that ``prepare@<object>`` and ``prepare-mesh@<mesh>`` declare in ``dvc.yaml``."""
    return ["prepare", f"meshes.{mesh}" if mesh else f"objects.{object_name}"]


def prepare(object_name: str, mesh: str) -> None:
    """Prepare one object, of the packages or of the user's own meshes, and write its folder."""
    settings, shape = load_parameters(sections(object_name, mesh)).values()
    from pipeline.prepare.portrait import portrait
    from pipeline.prepare.preparation import prepare_object
    from pipeline.prepare.sources import check_source

    name = mesh or object_name
    check_source(shape, name)
    check_writable(paths.prepared_folder(name))
    prepared = prepare_object(name, shape, settings)
    write_prepared_object(paths.prepared_folder(name), prepared, portrait(prepared))
    facts = prepared.provenance
    for repair in facts["repairs"]:
        print(f"{name}: {repair}")
    if "guessed_unit" in facts:
        unit, longest = facts["guessed_unit"], facts["longest_extent_in_file"]
        print(
            f"warning: meshes.{name}: the longest extent in the file is {longest:.4g}, taken as {unit}; confirm it "
            f"with `unit: {unit}`, or name the right unit.",
            file=sys.stderr,
        )


def main() -> int:
    """Parse the command line and run the stage."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.prepare", description=__doc__)
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--object", default="", help="name under `objects` in params.yaml")
    source.add_argument("--mesh", default="", help="name under `meshes` in params.yaml")
    chosen = parser.parse_args()
    stage = f"prepare-mesh@{chosen.mesh}" if chosen.mesh else f"prepare@{chosen.object}"
    return run_stage(stage, lambda: prepare(chosen.object, chosen.mesh))


if __name__ == "__main__":
    raise SystemExit(main())
