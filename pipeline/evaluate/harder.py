"""`python -m pipeline.evaluate.harder --setting placement`: some pairs tried once more in a harder setting.

Grasps, seeds and order are those of the standard trials, so that every row compares with the standard trial of the
same pair and number. Writes ``data/evaluate/harder/<setting>.parquet``.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from pipeline.evaluate.inputs import inputs_of_pairs
from pipeline.records import paths
from pipeline.records.parameters import load_parameters, read_parameters
from pipeline.records.parameters.harder import overridden
from pipeline.records.running import run_stage

if TYPE_CHECKING:
    from pipeline.evaluate.trial import TrialInput


def sections(setting: str) -> list[str]:
    """Parameter sections that ``evaluate-harder@<setting>`` declares in ``dvc.yaml``."""
    return ["seed", "physics", "evaluate", "harder.pairs", "harder.trials", f"harder.settings.{setting}"]


def inputs_of_setting(name: str, parameters: dict[str, Any]) -> list[TrialInput]:
    """Return the inputs of all trials of one setting: the first ``harder.trials`` of the standard ones, changed.

    Args:
        parameters: the ``sections(name)``.

    Raises:
        UserError: a table of grasps or an object is missing or damaged.
    """
    setting = parameters[f"harder.settings.{name}"]
    replaced = {
        "seed": parameters["seed"],
        "evaluate": overridden(parameters["evaluate"], setting.evaluate),
        "physics": overridden(parameters["physics"], setting.physics),
    }
    # Which grasp a trial tries depends on how many trials the standard has, so that all are made before some are left.
    inputs = [
        trial
        for first, second in parameters["harder.pairs"]
        for trial in inputs_of_pairs(setting.source, first, [second], replaced)
    ]
    return [trial for trial in inputs if trial.trial < parameters["harder.trials"]]


def evaluate(name: str) -> None:
    """Run all trials of one setting and write their table.

    Raises:
        UserError: an input is missing or damaged, or params.yaml does not name the setting.
    """
    parameters = load_parameters(sections(name))
    workers = read_parameters().compute

    import pandas as pd

    from pipeline.compute.fan_out import fan_out
    from pipeline.evaluate.trial import run_trial
    from pipeline.records.tables import TRIALS, write_table

    inputs = inputs_of_setting(name, parameters)
    rows = pd.DataFrame(fan_out(run_trial, inputs, workers, f"trials of {name}"), columns=TRIALS.names)
    write_table(paths.harder_file(name), rows, TRIALS)
    print(f"{name}: {int(rows['success'].sum())} of {len(rows)} trials lifted both objects")


def main() -> int:
    """Parse the command line and run the stage."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.evaluate.harder", description=__doc__)
    parser.add_argument("--setting", required=True, help="a name under harder.settings in params.yaml")
    arguments = parser.parse_args()
    return run_stage(f"evaluate-harder@{arguments.setting}", lambda: evaluate(arguments.setting))


if __name__ == "__main__":
    raise SystemExit(main())
