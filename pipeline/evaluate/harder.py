"""Some pairs tried once more in harder settings: ``data/evaluate/harder/<setting>.parquet``.

Grasps, seeds and order are those of the standard trials, so that every row compares with the standard trial of the
same pair and number. `python -m pipeline.evaluate.harder` brings all settings up to date, `--setting placement` runs
one by hand.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from pipeline.evaluate.inputs import inputs_of, trial_digests
from pipeline.records import paths
from pipeline.records.digests import digest, hand_digest
from pipeline.records.hands import ALLEGRO
from pipeline.records.parameters import load_with_workers
from pipeline.records.parameters.harder import HarderSetting, overridden
from pipeline.records.parameters.names import require_name
from pipeline.records.tables import TRIALS
from pipeline.stages.code import own_fingerprint
from pipeline.stages.items import Stage, make_by_hand, make_items
from pipeline.stages.outputs import Tables
from pipeline.stages.running import run_stage

if TYPE_CHECKING:
    from pipeline.evaluate.trial import TrialInput
    from pipeline.hand.model import Hand


def sections() -> list[str]:
    """Return the sections of ``params.yaml`` that the stage depends on."""
    return ["seed", "picks", "physics", "evaluate", "harder"]


def changed(setting: HarderSetting, parameters: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters of the standard trials with a setting's changes.

    Args:
        parameters: the ``sections()``.
    """
    return {
        "seed": parameters["seed"],
        "picks": parameters["picks"],
        "evaluate": overridden(parameters["evaluate"], setting.evaluate),
        "physics": overridden(parameters["physics"], setting.physics),
    }


def inputs_of_setting(key: str, parameters: dict[str, Any], hand: Hand) -> list[TrialInput]:
    """Return the inputs of all trials of one setting with some objects: the first standard ones, changed.

    Args:
        key: the setting's name and those of the objects, such as ``placement/cube/soup_can``.

    Raises:
        UserError: a table of grasps or an object is missing or damaged.
    """
    name, *objects = key.split("/")
    setting = parameters["harder"].settings[name]
    # Which grasp a trial tries depends on how many trials the standard has: all are made before some are dropped.
    inputs = inputs_of(setting.source, objects, changed(setting, parameters), hand)
    return inputs[: parameters["harder"].trials]


def evaluate(only: str) -> None:
    """Run the trials that are not up to date, or those of one setting by hand.

    Raises:
        UserError: an input is missing or damaged, or params.yaml does not name the setting.
    """
    parameters, workers = load_with_workers(sections())
    harder = parameters["harder"]
    if only:
        require_name(only, harder.settings, "harder.settings", kind="setting")

    from pipeline.evaluate.trials import trials_of
    from pipeline.hand.model import load_hand

    hand = load_hand(ALLEGRO)
    tables = Tables(paths.harder_file("").parent, TRIALS, ("objects", "trial"))
    stage = Stage("evaluate-harder", "trials", tables)
    keys = ["/".join([name, *objects]) for name in ([only] if only else harder.settings) for objects in harder.pairs]
    with trials_of(tables, lambda key: inputs_of_setting(key, parameters, hand)) as begin:
        if only:
            make_by_hand(stage, [f"{key}/{number}" for key in keys for number in range(harder.trials)], begin, workers)
            return
        common = digest(own_fingerprint("evaluate-harder"), hand_digest(hand.name))
        fingerprints: dict[str, str] = {}
        for key in keys:
            name, *objects = key.split("/")
            setting = harder.settings[name]
            own = trial_digests(setting.source, objects, changed(setting, parameters), hand)[: harder.trials]
            fingerprints |= {f"{key}/{number}": digest(common, trial) for number, trial in enumerate(own)}
        make_items(stage, fingerprints, begin, workers)


def main() -> int:
    """Parse the command line and run the stage."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline.evaluate.harder",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--setting", default="", help="a name under harder.settings in params.yaml")
    arguments = parser.parse_args()
    return run_stage("evaluate-harder", lambda: evaluate(arguments.setting))


if __name__ == "__main__":
    raise SystemExit(main())
