"""Synthesize grasp candidates: ``python -m pipeline.synthesize --style pinch --object cube``."""

from __future__ import annotations

import argparse
import sys

from pipeline.records import paths
from pipeline.records.objects import load_prepared_object
from pipeline.records.parameters import load_parameters, read_parameters
from pipeline.records.running import run_stage
from pipeline.records.tables import CANDIDATES, of_hand, write_table


def sections(style: str, object_name: str) -> list[str]:
    """Parameter sections that this stage reads; ``object_name`` enters through the prepared object."""
    return ["hand", "seed", "synthesize.energy", "synthesize.optimizer", f"synthesize.{style}"]


def synthesize_object(style: str, object_name: str) -> None:
    """Read parameters and prepared object, run the chains, write the table of candidates."""
    parameters = load_parameters(sections(style, object_name))
    workers = read_parameters().compute
    prepared = load_prepared_object(object_name)
    from pipeline.hand.model import load_hand
    from pipeline.synthesize.candidates import Request, synthesize

    hand = load_hand(parameters["hand"])
    hand.style(style)

    request = Request(
        prepared=prepared,
        style=style,
        run_seed=parameters["seed"],
        energy=parameters["synthesize.energy"],
        optimizer=parameters["synthesize.optimizer"],
        settings=parameters[f"synthesize.{style}"],
        hand=hand,
    )
    schema = of_hand(CANDIDATES, hand.name, hand.joint_count)
    write_table(paths.candidates_file(style, object_name), synthesize(request, workers), schema)


def main(arguments: list[str] | None = None) -> int:
    """Parse the command line and run the stage."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.synthesize", description=__doc__)
    parser.add_argument("--style", required=True, choices=("pinch", "side"), help="which fingers hold the object")
    parser.add_argument("--object", required=True, help="name of a prepared object")
    options = parser.parse_args(arguments)
    return run_stage(
        f"synthesize-{options.style}@{options.object}", lambda: synthesize_object(options.style, options.object)
    )


if __name__ == "__main__":
    sys.exit(main())
