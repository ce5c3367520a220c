"""`python -m pipeline.evaluate --source synthesized --object cube`: robot trials of all pairs that begin with it.

Writes ``data/evaluate/<source>/<object>.parquet``.
"""

from __future__ import annotations

import argparse

from pipeline.evaluate.inputs import GRASPS, inputs_of_pairs, second_objects, sections
from pipeline.records import paths
from pipeline.records.parameters import load_parameters, read_parameters
from pipeline.records.running import run_stage


def evaluate(source: str, first: str) -> None:
    """Run all trials of the pairs that begin with ``first`` and write their table.

    Raises:
        UserError: an input is missing or damaged, or params.yaml does not name the object for this source.
    """
    parameters = load_parameters(sections(source, first))
    workers = read_parameters().compute
    seconds = second_objects(source, first, parameters)

    import pandas as pd

    from pipeline.compute.fan_out import fan_out
    from pipeline.evaluate.trial import run_trial
    from pipeline.records.tables import TRIALS, write_table

    inputs = inputs_of_pairs(source, first, seconds, parameters)
    rows = pd.DataFrame(fan_out(run_trial, inputs, workers, f"trials of {first}"), columns=TRIALS.names)
    write_table(paths.trials_file(source, first), rows, TRIALS)
    for second in seconds:
        own = rows[rows["object1"] == second]
        print(f"{first} then {second}: {int(own['success'].sum())} of {len(own)} trials lifted both objects")


def main() -> int:
    """Parse the command line and run the stage."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.evaluate", description=__doc__)
    parser.add_argument("--source", required=True, choices=sorted(GRASPS), help="where the grasps come from")
    parser.add_argument("--object", required=True, help="the object that is picked first, a name in params.yaml")
    arguments = parser.parse_args()
    return run_stage(
        f"evaluate-{arguments.source}@{arguments.object}", lambda: evaluate(arguments.source, arguments.object)
    )


if __name__ == "__main__":
    raise SystemExit(main())
