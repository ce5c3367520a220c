"""``python -m pipeline.validate --style pinch --object cube``: which candidates survive physics."""

from __future__ import annotations

import argparse
import sys

from pipeline.records import paths
from pipeline.records.objects import load_prepared_object
from pipeline.records.parameters import load_parameters, read_parameters
from pipeline.records.running import run_stage
from pipeline.records.tables import CANDIDATES, VALIDATED, of_hand, read_table, write_table


def sections(style: str, object_name: str) -> list[str]:
    """Return the parameter sections that the stage depends on."""
    return ["hand", "physics", "validate"]


def main(style: str, object_name: str) -> None:
    """Test all candidates of one object in one style and write their rows with verdicts."""
    parameters = load_parameters(sections(style, object_name))
    from pipeline.hand.model import load_hand

    hand = load_hand(parameters["hand"])
    candidates = read_table(
        paths.candidates_file(style, object_name),
        of_hand(CANDIDATES, hand.name, hand.joint_count),
        f"synthesize-{style}@{object_name}",
    )
    prepared = load_prepared_object(object_name)
    from pipeline.validate.table import validate_table

    rows = validate_table(
        candidates,
        prepared,
        parameters["physics"],
        parameters["validate"],
        read_parameters().compute,
        f"validate-{style}@{object_name}",
        hand=hand,
    )
    write_table(paths.validated_file(style, object_name), rows, of_hand(VALIDATED, hand.name, hand.joint_count))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m pipeline.validate", description=__doc__)
    parser.add_argument("--style", required=True, choices=["pinch", "side"], help="how the object is grasped")
    parser.add_argument("--object", required=True, help="an object of params.yaml")
    arguments = parser.parse_args()
    sys.exit(
        run_stage(f"validate-{arguments.style}@{arguments.object}", lambda: main(arguments.style, arguments.object))
    )
