"""What the trials of a source depend on: its tables of grasps, the objects, the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from pipeline.records import paths
from pipeline.records.digests import digest, prepared_digest
from pipeline.records.parameters import chosen_pairs
from pipeline.records.parameters.names import require_name
from pipeline.records.sources import SOURCES

if TYPE_CHECKING:
    from pathlib import Path

    import pandas as pd

    from pipeline.evaluate.grasps import TwoObjectGrasp
    from pipeline.evaluate.trial import TrialInput
    from pipeline.records.objects import PreparedObject


def sections(source: str) -> list[str]:
    """Return the sections of ``params.yaml`` that ``evaluate@<source>`` depends on."""
    pairs = ["reconstructed"] if source == paths.RECONSTRUCTED else ["styles", "pairs"]
    return ["seed", *pairs, "physics", "evaluate"]


def pairs_of(source: str, parameters: dict[str, Any], first: str = "") -> dict[str, tuple[str, ...]]:
    """Return the pairs of a source: for each first object, or only for ``first``, the objects that are picked after it.

    Raises:
        UserError: params.yaml does not name ``first`` for this source.
    """
    if source != paths.RECONSTRUCTED:
        return chosen_pairs(parameters, first)
    chosen = parameters["reconstructed"]
    known = {name: tuple(item.side) for name, item in chosen.items()}
    if first:
        require_name(first, known, "reconstructed")
    return {first: known[first]} if first else known


def grasps_of_pair(source: str, first: str, second: str, parameters: dict[str, Any]) -> list[TwoObjectGrasp]:
    """Return the accepted grasps of a pair, in the frames of the true objects, the preferred first.

    Args:
        parameters: the ``sections(source)``.

    Raises:
        UserError: their table is missing or damaged.
    """
    from pipeline.evaluate.grasps import accepted_grasps
    from pipeline.evaluate.reconstructed import in_true_frames, true_from_reconstructed
    from pipeline.records.tables import pair_rows

    table = _grasps(source, first)
    grasps = accepted_grasps(pair_rows(table, second))
    if source != paths.RECONSTRUCTED:
        return grasps
    capture = parameters["reconstructed"][first].capture
    T0, T1 = (true_from_reconstructed(capture, _object(name)) for name in (first, second))
    return [in_true_frames(grasp, T0, T1) for grasp in grasps]


def _grasps(source: str, first: str) -> pd.DataFrame:
    """Return the grasps of a source that begin with an object."""
    table = SOURCES[source].table(first)
    return _read_grasps(table.absolute(), table, SOURCES[source].stage)


@lru_cache(maxsize=2)  # pairs of one first object come one after the other
def _read_grasps(place: Path, source: Path, made_by: str) -> pd.DataFrame:
    from pipeline.records.tables import MERGED, read_table

    return read_table(source, MERGED, made_by)


def _object(name: str) -> PreparedObject:
    return _read_object(paths.prepared_folder(name).absolute(), name)


@lru_cache(maxsize=16)
def _read_object(place: Path, name: str) -> PreparedObject:
    from pipeline.evaluate.scene import without_grid
    from pipeline.records.objects import load_prepared_object

    return without_grid(load_prepared_object(name))


def objects_of_pair(first: str, second: str) -> tuple[PreparedObject, PreparedObject]:
    """Return the objects of a pair as trials use them.

    Raises:
        UserError: one is missing or damaged.
    """
    return _object(first), _object(second)


def inputs_of_pair(source: str, first: str, second: str, parameters: dict[str, Any]) -> list[TrialInput]:
    """Return the inputs of all trials of a pair.

    Raises:
        UserError: its table of grasps or an object is missing or damaged.
    """
    from pipeline.evaluate.trial import trial_inputs

    return trial_inputs(
        source,
        objects_of_pair(first, second),
        grasps_of_pair(source, first, second, parameters),
        parameters["evaluate"],
        parameters["physics"],
        parameters["seed"],
    )


def inputs_of_pairs(source: str, first: str, seconds: Sequence[str], parameters: dict[str, Any]) -> list[TrialInput]:
    """Return the inputs of all trials of ``first`` with each of ``seconds``; see :func:`inputs_of_pair`."""
    return [trial for second in seconds for trial in inputs_of_pair(source, first, second, parameters)]


def trial_digests(source: str, first: str, second: str, parameters: dict[str, Any]) -> list[str]:
    """Return the digest of all that each trial of a pair depends on besides the code, in their order.

    Raises:
        UserError: see :func:`inputs_of_pair`.
    """
    from pipeline.evaluate.trial import trial_inputs

    digests = prepared_digest(first), prepared_digest(second)
    grasps = grasps_of_pair(source, first, second, parameters)
    settings, physics = parameters["evaluate"], parameters["physics"]
    # Settings that decide which trials there are do not change those that there are anyway.
    common = digest(source, digests, settings.model_copy(update={"trials": 0}), physics)
    known = {grasp.merged_id: digest(grasp) for grasp in grasps}
    trials = trial_inputs(source, objects_of_pair(first, second), grasps, settings, physics, parameters["seed"])
    return [digest(common, trial.seed, [known[grasp.merged_id] for grasp in trial.grasps]) for trial in trials]
