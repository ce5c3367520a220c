"""Robot trials of all pairs: ``data/evaluate/<source>/<first object>.parquet``.

`python -m pipeline.evaluate --source synthesized` brings all trials up to date, `--object cube` runs those that begin
with one object by hand. With `picks` of more than two objects they are trials of the whole sequences.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable

from pipeline.evaluate.inputs import inputs_of, sections, sequences_of, trial_digests
from pipeline.records import paths
from pipeline.records.digests import digest, hand_digest
from pipeline.records.parameters import load_with_workers
from pipeline.records.sources import SOURCES
from pipeline.records.tables import TRIALS, of_hand
from pipeline.stages.code import own_fingerprint
from pipeline.stages.items import Stage, fingerprints_of, make_by_hand, make_items
from pipeline.stages.outputs import Tables
from pipeline.stages.running import run_stage


def evaluate(source: str, only: str) -> None:
    """Run the trials of a source that are not up to date, or those of one first object by hand.

    Raises:
        UserError: an input is missing or damaged, or params.yaml does not name the object for this source.
    """
    parameters, workers = load_with_workers(sections(source))
    sequences = ["/".join(names) for names in sequences_of(source, parameters, only)]

    from pipeline.evaluate.trials import trials_of
    from pipeline.hand.model import load_hand
    from pipeline.hand.robot import require_arm

    hand = load_hand(parameters["hand"])
    require_arm(hand)
    tables = Tables(
        paths.trials_file(source, "").parent, of_hand(TRIALS, hand.name, hand.joint_count), ("objects", "trial")
    )
    stage = Stage(f"evaluate@{source}", "trials", tables)
    with trials_of(tables, lambda objects: inputs_of(source, objects.split("/"), parameters, hand)) as begin:
        if only:
            numbers = range(parameters["evaluate"].trials)
            make_by_hand(stage, [f"{objects}/{number}" for objects in sequences for number in numbers], begin, workers)
        else:
            common = digest(own_fingerprint("evaluate"), hand_digest(hand.name))
            digests, refused = fingerprints_of(
                sequences, lambda objects: trial_digests(source, objects.split("/"), parameters, hand)
            )
            fingerprints = {
                f"{objects}/{number}": digest(common, trial)
                for objects, trials in digests.items()
                for number, trial in enumerate(trials)
            }
            make_items(stage, fingerprints, begin, workers, refused)
    _print_outcomes(source, dict.fromkeys(objects.split("/")[0] for objects in sequences))


def _print_outcomes(source: str, firsts: Iterable[str]) -> None:
    from pyarrow.parquet import read_table

    for first in firsts:
        rows = read_table(paths.trials_file(source, first), columns=["objects", "success"]).to_pandas()
        for objects, own in rows.groupby(rows["objects"].map(" then ".join), sort=False)["success"]:
            print(f"{objects}: {int(own.sum())} of {len(own)} trials lifted all objects")


def main() -> int:
    """Parse the command line and run the stage."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline.evaluate", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--source", required=True, choices=sorted(SOURCES), help="where the grasps come from")
    parser.add_argument("--object", default="", help="the object that is picked first, a name in params.yaml")
    arguments = parser.parse_args()
    return run_stage(f"evaluate@{arguments.source}", lambda: evaluate(arguments.source, arguments.object))


if __name__ == "__main__":
    raise SystemExit(main())
