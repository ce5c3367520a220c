"""What the trials of a source depend on: its tables of grasps, the objects, the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pipeline.evaluate.grasps import SequenceGrasp, accepted_grasps
from pipeline.evaluate.reconstructed import in_true_frames, true_from_reconstructed
from pipeline.evaluate.trial import TrialInput, draws, trial_inputs
from pipeline.hand.model import Hand
from pipeline.records import paths
from pipeline.records.digests import digest, prepared_digest
from pipeline.records.kept import kept_object, kept_table
from pipeline.records.parameters import tried_sequences
from pipeline.records.parameters.names import require_name
from pipeline.records.sources import SOURCES
from pipeline.records.tables import MERGED, of_hand, rows_of


def sections(source: str) -> list[str]:
    """Return the sections of ``params.yaml`` that ``evaluate@<source>`` depends on."""
    objects = ["reconstructed"] if source == paths.RECONSTRUCTED else ["styles", "pairs"]
    return ["hand", "seed", *objects, "picks", "physics", "evaluate"]


def sequences_of(source: str, parameters: dict[str, Any], first: str = "") -> list[tuple[str, ...]]:
    """Return the objects of every sequence of a source, or of those that begin with ``first``, in order of picking.

    Raises:
        UserError: params.yaml does not name ``first`` for this source.
    """
    if source != paths.RECONSTRUCTED:
        return tried_sequences(parameters, first)
    chosen = parameters["reconstructed"]
    if first:
        require_name(first, chosen, "reconstructed")
    return [(name, second) for name, item in chosen.items() if first in ("", name) for second in item.side]


def grasps_of(source: str, objects: Sequence[str], parameters: dict[str, Any], hand: Hand) -> list[SequenceGrasp]:
    """Return the accepted grasps of some objects, in the frames of the true objects, the preferred first.

    Args:
        parameters: the ``sections(source)``.

    Raises:
        UserError: their table is missing or damaged.
    """
    from pipeline.pairing.task import groups_of

    schema = of_hand(MERGED, hand.name, hand.joint_count)
    rows = rows_of(kept_table(SOURCES[source].table(objects[0]), schema, SOURCES[source].stage), objects)
    grasps = accepted_grasps(rows, hand, groups_of(hand, parameters["picks"]), parameters["evaluate"].least_room)
    if source != paths.RECONSTRUCTED:
        return grasps
    capture = parameters["reconstructed"][objects[0]].capture
    T_true = [true_from_reconstructed(capture, kept_object(name, grid=False)) for name in objects]
    return [in_true_frames(grasp, T_true) for grasp in grasps]


def inputs_of(source: str, objects: Sequence[str], parameters: dict[str, Any], hand: Hand) -> list[TrialInput]:
    """Return the inputs of all trials with some objects.

    Raises:
        UserError: the table of grasps or an object is missing or damaged.
    """
    return trial_inputs(
        source,
        hand,
        parameters["picks"],
        [kept_object(name, grid=False) for name in objects],
        grasps_of(source, objects, parameters, hand),
        parameters["evaluate"],
        parameters["physics"],
        parameters["seed"],
        parameters.get("distribution"),
    )


def trial_digests(source: str, objects: Sequence[str], parameters: dict[str, Any], hand: Hand) -> list[str]:
    """Return the digest of all that each trial with some objects depends on besides the code, in their order.

    Raises:
        UserError: see :func:`inputs_of`.
    """
    digests = [prepared_digest(name) for name in objects]
    grasps = grasps_of(source, objects, parameters, hand)
    settings = parameters["evaluate"]
    # Settings that decide which trials there are do not change those that there are anyway.
    same = (
        settings.model_copy(update={"trials": 0}),
        parameters["physics"],
        parameters["picks"],
        parameters.get("distribution"),
    )
    common = digest(source, digests, same)
    known = [digest(grasp) for grasp in grasps]
    return [
        digest(common, drawn.seed, [known[index] for index in drawn.order])
        for drawn in draws(source, objects, len(grasps), settings, parameters["seed"])
    ]
