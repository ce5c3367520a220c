"""Test candidates of one style in physics: ``data/validate/<style>/<object>.parquet``.

`python -m pipeline.validate --style pinch` brings all objects of the style up to date, `--object cube` tests the
candidates of one by hand.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from pipeline.records import paths
from pipeline.records.digests import digest, file_digest, hand_digest, prepared_digest
from pipeline.records.errors import UserError
from pipeline.records.objects import load_prepared_object
from pipeline.records.parameters import load_with_workers
from pipeline.records.parameters.picks import PickParameters, PostParameters, pick_of
from pipeline.records.tables import CANDIDATES, VALIDATED, of_hand, read_table
from pipeline.stages.code import own_fingerprint
from pipeline.stages.items import Keep, Stage, fingerprints_of, make_by_hand, make_items
from pipeline.stages.outputs import Tables
from pipeline.stages.running import run_stage

if TYPE_CHECKING:
    import pandas as pd

    from pipeline.compute.pool import Work


def sections(style: str) -> list[str]:
    """Return the sections of ``params.yaml`` that the stage depends on."""
    return ["hand", "seed", f"styles.{style}", "picks", "physics", "validate", "robustness"]


def validate(style: str, only: str) -> None:
    """Test the candidates of the objects that are not up to date, or of one by hand."""
    parameters, workers = load_with_workers(sections(style))
    names = [only] if only else parameters.pop(f"styles.{style}")
    made_by, picks = f"synthesize@{style}", parameters.pop("picks")

    def pick(name: str) -> PickParameters | None:
        number = pick_of(picks, style, name)
        return None if number is None else picks[number]

    def inputs(name: str) -> str:
        return digest(prepared_digest(name), file_digest(paths.candidates_file(style, name), made_by))

    digests, refused = fingerprints_of(names, inputs)
    if only and refused:
        raise UserError(refused[only])
    from pipeline.hand.model import load_hand
    from pipeline.hand.support import support_of
    from pipeline.robustness.measures import measuring
    from pipeline.validate.table import validation

    hand = load_hand(parameters["hand"])
    tables = Tables(paths.validated_file(style, "").parent, of_hand(VALIDATED, hand.name, hand.joint_count))
    stage = Stage(f"validate@{style}", "objects", tables)

    def candidates(name: str) -> pd.DataFrame:
        schema = of_hand(CANDIDATES, hand.name, hand.joint_count)
        return read_table(paths.candidates_file(style, name), schema, made_by)

    def work(name: str, keep: Keep) -> Work[None]:
        rows = yield from validation(
            candidates(name),
            load_prepared_object(name),
            parameters["physics"],
            parameters["validate"],
            support_of(pick(name)),
            hand,
            measuring(parameters["robustness"], parameters["seed"], name),
        )
        keep(name, tables.rows(rows))

    def begin(names: Sequence[str], keep: Keep) -> list[tuple[str, Any]]:
        to_test = {name: int((candidates(name)["rejected_by"] == "").sum()) for name in names}
        return [(name, partial(work, name, keep)) for name in sorted(names, key=to_test.__getitem__, reverse=True)]

    if only:
        make_by_hand(stage, names, begin, workers)
        return
    common = digest(own_fingerprint("validate"), parameters, hand_digest(hand.name))
    fingerprints = {name: digest(common, name, _post(pick(name)), own) for name, own in digests.items()}
    make_items(stage, fingerprints, begin, workers, refused)


def _post(pick: PickParameters | None) -> PostParameters | None:
    return None if pick is None else pick.post


def main() -> int:
    """Parse the command line and run the stage."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline.validate", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--style", required=True, choices=["pinch", "side"], help="how the objects are grasped")
    parser.add_argument("--object", default="", help="an object of params.yaml")
    arguments = parser.parse_args()
    return run_stage(f"validate@{arguments.style}", lambda: validate(arguments.style, arguments.object))


if __name__ == "__main__":
    sys.exit(main())
