"""The record of one result as plain data: what MLflow is told, before anything is told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from pipeline.track.lock import HARDER, LockedStage, digest

UNKEYED = ("report",)  # its outputs follow from the summary and from package versions


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

    Code is left out on purpose: a changed comment gives the same result. All of it stands in files that are committed,
    so that a result has the same identity when it is read from git's history.
    """
    content = {stage.name: [stage.parameters, {} if stage.name in UNKEYED else stage.outputs] for stage in stages}
    return digest([summary, content])


def stage_metrics(stage: str, metrics: Mapping[str, float]) -> dict[str, float]:
    """Return the metrics of one stage, under names that are the same for every object.

    ``validate-pinch@cube`` gets ``validate.pinch.cube.survival_rate`` as ``survival_rate``; the stages of pairs keep
    the pair in the name: ``merge@cube`` gets ``cube--soup_can.accepted``, ``evaluate-synthesized@cube`` its own alike.
    ``evaluate-harder@placement`` gets ``evaluate.harder.placement.lost`` as ``lost``.
    """
    kind, _, item = stage.partition("@")
    prefix = kind.replace("-", ".") + "."
    if kind in ("merge", "sample") or (kind.startswith("evaluate-") and kind != HARDER):
        return {key.removeprefix(prefix): v for key, v in metrics.items() if key.startswith(f"{prefix}{item}--")}
    if item:
        prefix += f"{item}."
    return {key.removeprefix(prefix): value for key, value in metrics.items() if key.startswith(prefix)}


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
        parameters=dict(parameters),
        metrics=metrics,
        stages=[
            StageRecord(
                name=stage.name,
                fingerprint=stage.fingerprint,
                parameters=stage.parameters,
                metrics=stage_metrics(stage.name, metrics),
                durations={name: float(value) for name, value in durations.get(stage.name, {}).items()},
                curve=tuple(dict(row) for row in curves.get(stage.name, ())),
                inputs=stage.inputs,
                outputs=stage.outputs,
            )
            for stage in stages
        ],
    )
