"""`python -m pipeline.evaluate --source synthesized --object cube`: robot trials of all pairs that begin with it.

Writes ``data/evaluate/<source>/<object>.parquet``.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from pipeline.records import paths
from pipeline.records.parameters import load_parameters, read_parameters
from pipeline.records.running import run_stage

if TYPE_CHECKING:
    from pipeline.evaluate.trial import TrialInput

# Where the grasps of a source are, and the stage that makes them.
GRASPS = {
    "synthesized": (paths.merged_file, "merge"),
    "learned": (paths.sampled_file, "sample"),
    paths.RECONSTRUCTED: (paths.reconstructed_file, "sample-reconstructed"),
}


def sections(source: str, object_name: str) -> list[str]:
    """Parameter sections that ``evaluate-<source>@<object>`` declares in ``dvc.yaml``."""
    pairs = f"reconstructed.{object_name}" if source == paths.RECONSTRUCTED else "styles"
    return ["seed", pairs, "physics", "evaluate"]


def second_objects(source: str, first: str, parameters: dict[str, Any]) -> list[str]:
    """Return the names of the objects that are picked after ``first``.

    Raises:
        UserError: ``styles.pinch`` does not name the first object.
    """
    if source == paths.RECONSTRUCTED:
        return list(parameters[f"reconstructed.{first}"].side)
    return list(parameters["styles"].after(first))


def evaluate(source: str, first: str) -> None:
    """Run all trials of the pairs that begin with ``first`` and write their table.

    Raises:
        UserError: an input is missing or damaged, or params.yaml does not name the object for this source.
    """
    parameters = load_parameters(sections(source, first))
    workers = read_parameters().compute.workers
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


def inputs_of_pairs(source: str, first: str, seconds: Sequence[str], parameters: dict[str, Any]) -> list[TrialInput]:
    """Return the inputs of all trials of ``first`` with each of ``seconds``.

    Args:
        parameters: the ``sections(source, first)``.

    Raises:
        UserError: a table of grasps or an object is missing or damaged.
    """
    from pipeline.evaluate.grasps import accepted_grasps
    from pipeline.evaluate.reconstructed import in_true_frames, true_from_reconstructed
    from pipeline.evaluate.scene import without_grid
    from pipeline.evaluate.trial import trial_inputs
    from pipeline.records.objects import load_prepared_object
    from pipeline.records.tables import MERGED, read_table

    file_of, made_by = GRASPS[source]
    grasps = {
        second: accepted_grasps(read_table(file_of(first, second), MERGED, f"{made_by}@{first}")) for second in seconds
    }
    objects = {name: without_grid(load_prepared_object(name)) for name in dict.fromkeys([first, *seconds])}
    if source == paths.RECONSTRUCTED:
        capture = parameters[f"reconstructed.{first}"].capture
        T = {name: true_from_reconstructed(capture, prepared) for name, prepared in objects.items()}
        grasps = {
            second: [in_true_frames(grasp, T[first], T[second]) for grasp in own] for second, own in grasps.items()
        }
    return [
        trial
        for second in seconds
        for trial in trial_inputs(
            source,
            (objects[first], objects[second]),
            grasps[second],
            parameters["evaluate"],
            parameters["physics"],
            parameters["seed"],
        )
    ]


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
