"""Robot trials of all pairs: ``data/evaluate/<source>/<first object>.parquet``.

`python -m pipeline.evaluate --source synthesized` brings all trials up to date, `--object cube` runs those of the pairs
that begin with one object by hand.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from pipeline.evaluate.inputs import inputs_of_pair, pairs_of, sections, trial_digests
from pipeline.records import paths
from pipeline.records.digests import digest, hand_digest
from pipeline.records.parameters import load_with_workers
from pipeline.records.parameters.hand import ALLEGRO
from pipeline.records.sources import SOURCES
from pipeline.records.tables import TRIALS
from pipeline.stages.code import own_fingerprint
from pipeline.stages.items import Stage, make_by_hand, make_items
from pipeline.stages.outputs import Tables
from pipeline.stages.running import run_stage

if TYPE_CHECKING:
    from pipeline.evaluate.trial import TrialInput


def evaluate(source: str, only: str) -> None:
    """Run the trials of a source that are not up to date, or those of one first object by hand.

    Raises:
        UserError: an input is missing or damaged, or params.yaml does not name the object for this source.
    """
    parameters, workers = load_with_workers(sections(source))
    pairs = [(first, second) for first, seconds in pairs_of(source, parameters, only).items() for second in seconds]

    from pipeline.evaluate.trials import trials_of

    tables = Tables(paths.trials_file(source, "").parent, TRIALS, ("object1", "trial"))
    stage = Stage(f"evaluate@{source}", "trials", tables)

    def inputs_of(pair: str) -> list[TrialInput]:
        first, second = pair.split("/")
        return inputs_of_pair(source, first, second, parameters)

    with trials_of(tables, inputs_of) as begin:
        if only:
            numbers = range(parameters["evaluate"].trials)
            make_by_hand(stage, [f"{'/'.join(pair)}/{number}" for pair in pairs for number in numbers], begin, workers)
        else:
            common = digest(own_fingerprint("evaluate"), hand_digest(ALLEGRO))
            fingerprints = {
                f"{'/'.join(pair)}/{number}": digest(common, own)
                for pair in pairs
                for number, own in enumerate(trial_digests(source, *pair, parameters))
            }
            make_items(stage, fingerprints, begin, workers)
    _print_outcomes(source, pairs)


def _print_outcomes(source: str, pairs: list[tuple[str, str]]) -> None:
    from pyarrow.parquet import read_table

    for first in dict.fromkeys(first for first, _ in pairs):
        rows = read_table(paths.trials_file(source, first), columns=["object1", "success"]).to_pandas()
        for second, own in rows.groupby("object1", sort=False):
            print(f"{first} then {second}: {int(own['success'].sum())} of {len(own)} trials lifted both objects")


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
