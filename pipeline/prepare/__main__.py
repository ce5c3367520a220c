"""`python -m pipeline.prepare --object cube`: make ``data/prepare/<object>/``."""

from __future__ import annotations

import argparse

from pipeline.records import paths
from pipeline.records.objects import write_prepared_object
from pipeline.records.parameters import load_parameters
from pipeline.records.running import run_stage


def sections(object_name: str) -> list[str]:
    """Parameter sections that ``prepare@<object>`` declares in ``dvc.yaml``."""
    return ["prepare", f"objects.{object_name}"]


def prepare(object_name: str) -> None:
    """Prepare one object and write its folder."""
    parameters = load_parameters(sections(object_name))
    from pipeline.prepare.preparation import prepare_object
    from pipeline.prepare.sources import check_source

    shape = parameters[f"objects.{object_name}"]
    check_source(shape, object_name)
    prepared = prepare_object(object_name, shape, parameters["prepare"])
    write_prepared_object(paths.prepared_folder(object_name), prepared)


def main() -> int:
    """Parse the command line and run the stage."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.prepare", description=__doc__)
    parser.add_argument("--object", required=True, help="name of an object in params.yaml")
    object_name = parser.parse_args().object
    return run_stage(f"prepare@{object_name}", lambda: prepare(object_name))


if __name__ == "__main__":
    raise SystemExit(main())
