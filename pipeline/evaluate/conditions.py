"""Some pairs tried again under other conditions: ``data/evaluate/conditions/<source>-<condition>-<engine>.parquet``.

Grasps, seeds and order are those of the standard trials, so that every row compares with the standard trial of the
same pair and number. `python -m pipeline.evaluate.conditions` brings all series up to date,
`--series learned-mu_0_5-sapien` runs one by hand.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from pipeline.evaluate.inputs import inputs_of, sequences_of, trial_digests
from pipeline.records import paths
from pipeline.records.digests import digest, hand_digest
from pipeline.records.parameters import load_with_workers
from pipeline.records.parameters.conditions import under
from pipeline.records.parameters.names import require_name
from pipeline.records.series import STAGE, TrialSeries
from pipeline.records.sources import SOURCES
from pipeline.records.tables import TRIALS, of_hand
from pipeline.stages.code import own_fingerprint
from pipeline.stages.items import Stage, fingerprints_of, make_by_hand, make_items
from pipeline.stages.outputs import Tables
from pipeline.stages.running import run_stage

if TYPE_CHECKING:
    from pipeline.evaluate.trial import TrialInput
    from pipeline.hand.model import Hand


def sections() -> list[str]:
    """Return the sections of ``params.yaml`` that the stage depends on."""
    return ["hand", "seed", "reconstructed", "picks", "physics", "evaluate", "conditions"]


def series_to_run(parameters: dict[str, Any]) -> dict[str, TrialSeries]:
    """Return all series by name but those that are the standard trials.

    Args:
        parameters: the ``sections()``.
    """
    reconstructed = bool(parameters["reconstructed"])
    return parameters["conditions"].to_run(reconstructed, parameters["evaluate"], parameters["physics"])  # type: ignore[no-any-return]


def pairs_of(series: TrialSeries, parameters: dict[str, Any]) -> list[tuple[str, ...]]:
    """Return the objects of every pair that a series tries, in the order of picking."""
    if SOURCES[series.source].of_all_pairs:
        return list(parameters["conditions"].pairs)
    return sequences_of(series.source, parameters)


def parameters_of(series: TrialSeries, parameters: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters of the standard trials as a series changes them.

    Args:
        parameters: the ``sections()``.
    """
    conditions = parameters["conditions"]
    condition = conditions.settings[series.condition]
    evaluate, physics = under(condition, series.engine, parameters["evaluate"], parameters["physics"])
    return {
        **{name: parameters[name] for name in ("seed", "picks", "reconstructed")},
        "evaluate": evaluate,
        "physics": physics,
        "distribution": conditions.distribution if condition.drawn else None,
    }


def inputs_of_series(key: str, parameters: dict[str, Any], hand: Hand) -> list[TrialInput]:
    """Return the inputs of all trials of one series with some objects: the first standard ones, changed.

    Args:
        key: the series' name and those of the objects, such as ``learned-mu_0_5-sapien/cube/soup_can``.
        parameters: the ``sections()``.

    Raises:
        UserError: a table of grasps or an object is missing or damaged.
    """
    name, *objects = key.split("/")
    series = series_to_run(parameters)[name]
    # Which grasp a trial tries depends on how many trials the standard has: all are made before some are dropped.
    inputs = inputs_of(series.source, objects, parameters_of(series, parameters), hand)
    return inputs[: parameters["conditions"].trials]


def evaluate(only: str) -> None:
    """Run the trials that are not up to date, or those of one series by hand.

    Raises:
        UserError: an input is missing or damaged, or params.yaml does not name the series.
    """
    parameters, workers = load_with_workers(sections())
    chosen = series_to_run(parameters)
    if only:
        require_name(only, chosen, "conditions", kind="series")
        chosen = {only: chosen[only]}

    from pipeline.evaluate.trials import trials_of
    from pipeline.hand.model import load_hand
    from pipeline.hand.robot import require_arm

    hand = load_hand(parameters["hand"])
    require_arm(hand)
    tables = Tables(paths.series_file("").parent, of_hand(TRIALS, hand.name, hand.joint_count), ("objects", "trial"))
    stage = Stage(STAGE, "trials", tables)
    keys = ["/".join([name, *objects]) for name, series in chosen.items() for objects in pairs_of(series, parameters)]
    with trials_of(tables, lambda key: inputs_of_series(key, parameters, hand)) as begin:
        if only:
            numbers = range(parameters["conditions"].trials)
            make_by_hand(stage, [f"{key}/{number}" for key in keys for number in numbers], begin, workers)
            return
        common = digest(own_fingerprint(STAGE), hand_digest(hand.name))

        def digests_of(key: str) -> list[str]:
            name, *objects = key.split("/")
            own = trial_digests(chosen[name].source, objects, parameters_of(chosen[name], parameters), hand)
            return own[: parameters["conditions"].trials]

        digests, refused = fingerprints_of(keys, digests_of)
        fingerprints = {
            f"{key}/{number}": digest(common, trial)
            for key, trials in digests.items()
            for number, trial in enumerate(trials)
        }
        make_items(stage, fingerprints, begin, workers, refused)


def main() -> int:
    """Parse the command line and run the stage."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline.evaluate.conditions",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--series", default="", help="a source, a condition and an engine, joined by hyphens")
    arguments = parser.parse_args()
    return run_stage(STAGE, lambda: evaluate(arguments.series))


if __name__ == "__main__":
    raise SystemExit(main())
