"""The record of one result as plain data: what MLflow gets, before it gets anything."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from pipeline.track.lock import HARDER, LockedStage, digest

UNKEYED = ("report",)  # its outputs follow from the summary and from package versions
# A record has at most about 2,000 rows, however large the run is.
MOST_MEMBERS = 32  # of a mapping of parameters, such as objects
MOST_LETTERS = 6000  # of a parameter: MLflow's limit
MOST_POINTS = 100  # of a curve


@dataclass(frozen=True)
class StageRecord:
    """One nested run."""

    name: str
    fingerprint: str
    parameters: dict[str, Any]
    metrics: dict[str, float]  # of this stage, without the stage's own prefix
    durations: dict[str, float]  # empty when unknown
    curve: tuple[dict[str, float], ...] = ()  # metrics on the way, each with its ``step``
    inputs: Mapping[str, str] = field(default_factory=dict)  # path -> DVC's hash of the data that it read
    outputs: Mapping[str, str] = field(default_factory=dict)  # and wrote


@dataclass(frozen=True)
class Record:
    """One parent run and its nested runs."""

    key: str
    parameters: dict[str, Any]
    metrics: dict[str, float]
    stages: list[StageRecord]

    def data_versions(self) -> dict[str, str]:
        """Return DVC's hash of everything that the stages wrote, but for the report."""
        return {
            path: text for stage in self.stages if stage.name not in UNKEYED for path, text in stage.outputs.items()
        }

    def counts(self) -> dict[str, int | str]:
        """Return the content of ``reports/tracking.json``: the key and how much was recorded under it."""
        return {
            "key": self.key,
            "metrics": len(self.metrics),
            "parameters": len(self.parameters),
            "stages": len(self.stages),
        }


def numbers(summary: Mapping[str, Any]) -> dict[str, float]:
    """Return the figures of the summary; its texts are parameters already."""
    return {
        key: float(value)
        for key, value in summary.items()
        if isinstance(value, int | float) and not isinstance(value, bool)
    }


def result_key(summary: Mapping[str, Any], stages: Sequence[LockedStage]) -> str:
    """Return the identity of a result: its figures, and the parameters and hashes of outputs of all stages.

    Code is left out on purpose: other code that writes the same gives the same result. All of it stands in files that
    are committed,
    so that a result has the same identity when it is read from git's history.
    """
    content = {stage.name: [stage.parameters, {} if stage.name in UNKEYED else stage.outputs] for stage in stages}
    return digest([summary, content])


def stage_metrics(stage: str, metrics: Mapping[str, float]) -> dict[str, float]:
    """Return the metrics of one stage, without what all of them begin with.

    ``validate@pinch`` gets ``validate.pinch.cube.survival_rate`` as ``cube.survival_rate``, ``merge`` gets
    ``merge.cube--soup_can.accepted`` as ``cube--soup_can.accepted``, and ``sample@learned`` those of ``sample``, as
    samples of reconstructed objects have none.

    In the past, stages were of single objects: ``validate-pinch@cube`` gets ``validate.pinch.cube.survival_rate`` as
    ``survival_rate``; the stages of pairs keep the pair in the name: ``merge@cube`` gets ``cube--soup_can.accepted``,
    ``evaluate-synthesized@cube`` its own alike. ``evaluate-harder@placement`` gets ``evaluate.harder.placement.lost``
    as ``lost``.
    """
    kind, _, item = stage.partition("@")
    prefix = kind.replace("-", ".") + "."
    if stage == "sample@learned":
        return {key.removeprefix(prefix): value for key, value in metrics.items() if key.startswith(prefix)}
    if item and (kind in ("merge", "sample") or (kind.startswith("evaluate-") and kind != HARDER)):
        return {key.removeprefix(prefix): v for key, v in metrics.items() if key.startswith(f"{prefix}{item}--")}
    if item:
        prefix += f"{item}."
    return {key.removeprefix(prefix): value for key, value in metrics.items() if key.startswith(prefix)}


def condensed(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return flat parameters of which long parts are a count and a digest; ``params.yaml`` is kept with the record.

    ``objects.cube.density`` and all else of more than ``MOST_MEMBERS`` objects becomes ``objects.count`` and
    ``objects.digest``, equal for equal values; a text that MLflow would cut off becomes its length and its digest.
    """
    members: dict[str, set[str]] = {}
    for name in parameters:
        parts = name.split(".")
        for depth in range(1, len(parts)):
            members.setdefault(".".join(parts[:depth]), set()).add(parts[depth])
    long = {prefix for prefix, own in members.items() if len(own) > MOST_MEMBERS}
    short: dict[str, Any] = {}
    parts_of_long: dict[str, dict[str, Any]] = {}
    for name, value in parameters.items():
        parts = name.split(".")
        prefixes = (".".join(parts[:depth]) for depth in range(1, len(parts)))
        if whole := next((prefix for prefix in prefixes if prefix in long), None):
            parts_of_long.setdefault(whole, {})[name] = value
        else:
            text = str(value)
            short[name] = value if len(text) <= MOST_LETTERS else f"{len(text)} letters, digest {digest(text)}"
    for whole, content in parts_of_long.items():
        short |= {f"{whole}.count": len(members[whole]), f"{whole}.digest": digest(content)}
    return short


def thinned(curve: Sequence[Mapping[str, float]]) -> tuple[dict[str, float], ...]:
    """Return at most ``MOST_POINTS`` points of a curve, spread evenly over it, the last one among them."""
    count = min(len(curve), MOST_POINTS)
    return tuple(dict(curve[(index + 1) * len(curve) // count - 1]) for index in range(count))


def build_record(
    summary: Mapping[str, Any],
    parameters: Mapping[str, Any],
    stages: Sequence[LockedStage],
    durations: Mapping[str, Mapping[str, float]],
    curves: Mapping[str, Sequence[Mapping[str, float]]] = MappingProxyType({}),
) -> Record:
    """Return the record of one result.

    Args:
        parameters: flat.
        durations: per DVC stage name.
        curves: per DVC stage name, rows with ``step`` and metrics.
    """
    metrics = numbers(summary)
    return Record(
        key=result_key(summary, stages),
        parameters=condensed(parameters),
        metrics=metrics,
        stages=[
            StageRecord(
                name=stage.name,
                fingerprint=stage.fingerprint,
                parameters=condensed(stage.parameters),
                metrics=stage_metrics(stage.name, metrics),
                durations={name: float(value) for name, value in durations.get(stage.name, {}).items()},
                curve=thinned(curves.get(stage.name, ())),
                inputs=stage.inputs,
                outputs=stage.outputs,
            )
            for stage in stages
        ],
    )
