"""One trial of a table, run again alone, and compared with its row to the last bit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.evaluate import conditions, inputs
from pipeline.evaluate.execution import Run
from pipeline.evaluate.scene import placement_offsets
from pipeline.evaluate.trial import TrialInput, run_trial
from pipeline.hand.model import Hand
from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.parameters import load_parameters
from pipeline.records.parameters.names import require_name
from pipeline.records.series import STAGE, TrialSeries, series_of
from pipeline.records.sources import SOURCES
from pipeline.records.tables import TRIALS, of_hand, read_table, rows_of
from pipeline.stages.seeds import item_generator

EXAMPLE = "synthesized/cube/soup_can/3"


@dataclass(frozen=True, order=True)
class TrialName:
    """What names one row of the tables of trials; written ``source/first/second/number``, with all its objects.

    In the place of the source may stand a series of trials under a condition, such as ``learned-mu_0_5-sapien``.
    """

    source: str
    objects: tuple[str, ...]  # in the order of picking
    number: int

    def __str__(self) -> str:
        return "/".join([self.source, *self.objects, str(self.number)])

    @property
    def objects_in_words(self) -> str:
        """The objects in a sentence."""
        return " and ".join(self.objects)

    @property
    def table(self) -> Path:
        """The file that holds the row."""
        return self.series.table if self.series else paths.trials_file(self.source, self.objects[0])

    @property
    def stage(self) -> str:
        """The DVC stage that writes it."""
        return STAGE if self.series else f"evaluate@{self.source}"

    @property
    def series(self) -> TrialSeries | None:
        """The series that the trial belongs to, None for a standard trial."""
        return series_of(self.source)


def trial_name(text: str) -> TrialName:
    """Read ``source/first/second/number``.

    Raises:
        UserError: the text names no trial.
    """
    source, *objects, number = text.split("/") if "/" in text else (text, "")
    if len(objects) < 2 or not number.isdecimal():
        raise UserError(
            f"{text!r} names no trial; write source, all objects and the trial's number, such as {EXAMPLE}."
        )
    if source not in SOURCES and series_of(source) is None:
        raise UserError(
            f"{text!r}: there is no source {source!r}; use one of {', '.join(sorted(SOURCES))}, or a series such as "
            "learned-mu_0_5-sapien."
        )
    return TrialName(source, tuple(objects), int(number))


def recorded_row(name: TrialName) -> dict[str, Any]:
    """Return the row of a trial.

    Raises:
        UserError: the table is missing or damaged, or has no such row.
    """
    rows = read_table(name.table, TRIALS, name.stage)
    same = rows_of(rows, name.objects)
    if same.empty:
        known = ", ".join(dict.fromkeys("/".join(list(objects)[1:]) for objects in rows["objects"]))
        raise UserError(f"{name.table} has no trials of {name.objects_in_words}; its second objects are {known}.")
    own = same[same["trial"] == name.number]
    if own.empty:
        numbers = f"{same['trial'].min()} to {same['trial'].max()}"
        raise UserError(f"{name.table} has no trial {name.number} of this pair; its trials are {numbers}.")
    return {str(column): value for column, value in own.iloc[0].items()}


def input_of_trial(name: TrialName, recorded: Mapping[str, Any], hand: Hand) -> TrialInput:
    """Return what the trial depends on, made as the stage makes it, from params.yaml and the tables of grasps.

    Raises:
        UserError: an input is missing, or is seen to be another than that of the row.
    """
    known = _inputs_of(name, hand)
    again = f"undo the change, or run `dvc repro {name.stage}` for a new table"
    if name.number >= len(known):
        most = "conditions.trials" if name.series else "evaluate.trials"
        raise UserError(
            f"{name.table} has trial {name.number}, but {most} in params.yaml is {len(known)} now; {again}."
        )
    own = known[name.number]
    if own.seed != recorded["seed"]:
        raise UserError(
            f"{name.table} was made with another `seed` in params.yaml (this trial: {recorded['seed']}, now "
            f"{own.seed}); {again}."
        )
    offsets = placement_offsets(len(own.picks), own.settings, np.random.Generator(np.random.PCG64(own.seed)))
    if not np.array_equal(offsets, np.stack(recorded["offsets"])):
        raise UserError(
            f"{name.table} was made with another evaluate.perturbation or evaluate.yaw_perturbation in params.yaml;"
            f" {again}."
        )
    tried = [grasp.merged_id for grasp in own.grasps]
    if recorded["merged_id"] >= 0 and recorded["merged_id"] not in tried:
        raise UserError(
            f"the grasps of the pair or evaluate.planning_attempts have changed since {name.table} was made: the trial "
            f"used grasp {recorded['merged_id']} and would now try {', '.join(map(str, tried)) or 'none'}; {again}."
        )
    return own


def _inputs_of(name: TrialName, hand: Hand) -> Sequence[TrialInput]:
    """Return the inputs of all trials of the same table with the same objects, as params.yaml is now."""
    if name.series is not None:
        return _inputs_of_series(name, name.series, hand)
    parameters = load_parameters(inputs.sections(name.source))
    if name.objects not in inputs.sequences_of(name.source, parameters):
        raise _gone(name)
    return inputs.inputs_of(name.source, name.objects, parameters, hand)


def _inputs_of_series(name: TrialName, series: TrialSeries, hand: Hand) -> Sequence[TrialInput]:
    parameters = load_parameters(conditions.sections())
    require_name(name.source, conditions.series_to_run(parameters), "conditions", kind="series")
    if name.objects not in conditions.pairs_of(series, parameters):
        raise _gone(name)
    return conditions.inputs_of_series("/".join([name.source, *name.objects]), parameters, hand)


def _gone(name: TrialName) -> UserError:
    return UserError(f"params.yaml does not name the pair {name.objects_in_words} any more; add it again.")


def run_again(
    name: TrialName, hand: Hand, watch: Callable[[Run], None] | None = None
) -> tuple[TrialInput, dict[str, Any], list[str]]:
    """Run a trial alone; return its inputs, its row, and the columns in which it differs from the recorded row.

    Raises:
        UserError: see :func:`recorded_row` and :func:`input_of_trial`.
    """
    recorded = recorded_row(name)
    own = input_of_trial(name, recorded, hand)
    row = run_trial(own, watch)
    return own, row, differing_columns(recorded, row, hand)


def differences(hand: Hand, name: TrialName) -> list[str]:
    """Run a trial alone and return the columns in which it differs from its row."""
    return run_again(name, hand)[2]


def differing_columns(recorded: Mapping[str, Any], row: Mapping[str, Any], hand: Hand) -> list[str]:
    """Return the columns in which two rows would not be the same bytes in the table."""
    columns = of_hand(TRIALS, hand.name, hand.joint_count)
    return [one.name for one in columns if _exact(recorded[one.name], one.type) != _exact(row[one.name], one.type)]


def _exact(value: Any, kind: pa.DataType) -> Any:
    """Return a value as a column of the table holds it, with floats as text that shows all their bits."""
    return _with_all_bits(pa.array([value], type=kind, from_pandas=True).to_pylist()[0])


def _with_all_bits(value: Any) -> Any:
    if isinstance(value, list):
        return [_with_all_bits(part) for part in value]
    return value.hex() if isinstance(value, float) else value


def known_trials() -> list[TrialName]:
    """Return all trials of all tables, in order.

    Raises:
        UserError: there are none, or a table is damaged.
    """
    found = []
    standard = {source: f"evaluate@{source}" for source in SOURCES}
    tables = [(source, stage, paths.trials_file(source, "").parent) for source, stage in standard.items()]
    files = [(source, stage, file) for source, stage, folder in tables for file in sorted(folder.glob("*.parquet"))]
    files += [(file.stem, STAGE, file) for file in sorted(paths.series_file("").parent.glob("*.parquet"))]
    for source, stage, file in files:
        rows = read_table(file, TRIALS, stage)
        found += [
            TrialName(source, tuple(objects), int(number))
            for objects, number in zip(rows["objects"], rows["trial"], strict=True)
        ]
    if not found:
        raise UserError("there are no tables of trials under data/evaluate; run `dvc repro` to make them.")
    return sorted(found)


def drawn_trials(known: Sequence[TrialName], count: int, draw: int) -> list[TrialName]:
    """Return ``count`` of the trials (or all, if there are fewer), chosen at random by the number ``draw``."""
    order = item_generator(draw, "replay").permutation(len(known))[:count]
    return [known[index] for index in order]
