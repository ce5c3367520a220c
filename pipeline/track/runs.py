"""Records as MLflow runs: one parent run per distinct result, one nested run per stage."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.records import paths
from pipeline.track.record import Record, StageRecord
from pipeline.track.store import (
    alone,
    database_errors,
    experiment_id,
    experiment_on_server,
    open_client,
    open_server,
    server_errors,
)

if TYPE_CHECKING:
    from mlflow.entities import Run
    from mlflow.tracking import MlflowClient

KIND_TAG, KEY_TAG, LACKS_TAG = "record.kind", "record.key", "record.lacks"
STAGE_TAG, FINGERPRINT_TAG, STATE_TAG = "dvc.stage", "dvc.stage_fingerprint", "dvc.stage_state"
FIRST_RUN_TAG = "dvc.first_run_id"
STAGES_RUN_TAG, STAGES_REUSED_TAG, DATA_TAG = "dvc.stages_run", "dvc.stages_reused", "dvc.data"
FRESH, REUSED = "fresh", "reused"
RECORDED, COMPLETED, KNOWN = "recorded", "completed", "was recorded before, nothing added"
MOST_PARAMETERS, MOST_METRICS, MOST_DATA = 100, 900, 900  # MLflow's limits of one batch are 100, 1000, 1000
MOST_TAG_LETTERS = 5000


@dataclass(frozen=True)
class Origin:
    """What a record says beside the result itself."""

    name: str  # of the parent run
    tags: Mapping[str, str]
    files: Sequence[Path] = ()  # to keep with the parent run
    lacks: str = ""  # what could not be had, in words; the same record with it completes this one
    began: float | None = None  # seconds since 1970; None: now
    stamp: float = field(default_factory=time.time)  # of what is recorded now

    @property
    def milliseconds(self) -> int:
        """When the run began, for MLflow."""
        return int(1000 * (self.stamp if self.began is None else self.began))

    @property
    def ended(self) -> int:
        """When it ended: now, or when it began where only one time is known."""
        return self.milliseconds if self.began is not None else int(1000 * time.time())


def write_record(root: Path, experiment: str, record: Record, origin: Origin, server: str = "") -> str:
    """Record one result and return :data:`RECORDED`, :data:`KNOWN` when it is there, or :data:`COMPLETED`.

    A parent run counts once it is finished; what an interrupted recording left behind is deleted first.

    Args:
        root: the repository; the database and the artifacts lie in it.
        server: address of an MLflow server that records instead.

    Raises:
        UserError: the database, the artifact folder or the server cannot be used.
    """
    with alone(root):
        if server:
            client = open_server(server)
            with server_errors(server):
                return _write_once(client, experiment_on_server(client, experiment), record, origin)
        client = open_client(root)
        with database_errors(root / paths.TRACKING_DATABASE):
            return _write_once(client, experiment_id(client, experiment, root), record, origin)


def _write_once(client: MlflowClient, home: str, record: Record, origin: Origin) -> str:
    _delete_unfinished(client, home)
    known = _first_run(client, home, f"tags.`{KEY_TAG}` = '{record.key}'")
    if known:
        return _complete(client, home, known, record, origin)
    _write(client, home, record, origin)
    return RECORDED


def _write(client: MlflowClient, home: str, record: Record, origin: Origin) -> None:
    tags = {**origin.tags, KIND_TAG: "result", KEY_TAG: record.key, **_data_tags(record)}
    tags |= {LACKS_TAG: origin.lacks} if origin.lacks else {}
    parent = client.create_run(home, start_time=origin.milliseconds, run_name=origin.name, tags=tags)
    parent_id = parent.info.run_id
    _log(client, parent_id, record.parameters, record.metrics, origin)
    _log_data(client, parent_id, {"result": record.data_versions()})
    states = {
        stage.name: _write_stage(client, home, parent_id, stage, origin, index)
        for index, stage in enumerate(record.stages)
    }
    _log_states(client, parent_id, record.stages, states, origin)
    _keep(client, home, parent_id, record, origin)
    client.set_terminated(parent_id, end_time=origin.ended)


def _complete(client: MlflowClient, home: str, known: Run, record: Record, origin: Origin) -> str:
    """Add what the record lacked when it was written, if it is there now."""
    lacked = known.data.tags.get(LACKS_TAG, "")
    if not lacked or origin.lacks == lacked:
        return KNOWN
    _keep(client, home, known.info.run_id, record, origin)
    client.set_tag(known.info.run_id, LACKS_TAG, origin.lacks)
    return COMPLETED


def _keep(client: MlflowClient, home: str, parent_id: str, record: Record, origin: Origin) -> None:
    """Keep the files and the curves, under the parent too: there results are compared."""
    for file in origin.files:
        client.log_artifact(parent_id, str(file))
    for stage in record.stages:
        _log_curve(client, parent_id, f"{stage.name}.curve", stage.curve, origin)
        if stage.curve:
            nested = f"tags.mlflow.parentRunId = '{parent_id}' and tags.`{STAGE_TAG}` = '{stage.name}'"
            run = _first_run(client, home, f"{nested} and tags.`{STATE_TAG}` = '{FRESH}'")
            if run:
                _log_curve(client, run.info.run_id, "curve", stage.curve, origin)


def _write_stage(
    client: MlflowClient, home: str, parent_id: str, stage: StageRecord, origin: Origin, index: int
) -> str:
    """Write one nested run and return its state."""
    begin = origin.milliseconds + 1 + index  # in order of the stages
    fingerprint = f"tags.`{FINGERPRINT_TAG}` = '{stage.fingerprint}' and tags.`{STATE_TAG}` = '{FRESH}'"
    first = _first_run(client, home, f"{fingerprint} and attributes.start_time <= {begin}")
    state = REUSED if first else FRESH
    tags = {
        "mlflow.parentRunId": parent_id,
        KIND_TAG: "stage",
        STAGE_TAG: stage.name,
        FINGERPRINT_TAG: stage.fingerprint,
        STATE_TAG: state,
    }
    if first:
        tags[FIRST_RUN_TAG] = first.info.run_id
    run = client.create_run(home, start_time=begin, run_name=stage.name, tags=tags)
    # A reused stage cost this result nothing: its durations stay with the run that paid for them.
    metrics = stage.metrics if first else {**stage.metrics, **stage.durations}
    _log(client, run.info.run_id, stage.parameters, metrics, origin)
    _log_data(client, run.info.run_id, {"input": stage.inputs, "output": stage.outputs})
    client.set_terminated(run.info.run_id, end_time=max(begin, origin.ended))
    return state


def _data_tags(record: Record) -> dict[str, str]:
    """Return the data versions as tags: MLflow compares tags side by side, but not data sets."""
    return {f"{DATA_TAG}.{path}": text for path, text in record.data_versions().items()}


def _log_states(
    client: MlflowClient,
    parent_id: str,
    stages: Sequence[StageRecord],
    states: Mapping[str, str],
    origin: Origin,
) -> None:
    """Say on the parent which stages were run for this result, and what they cost."""
    for tag, state in ((STAGES_RUN_TAG, FRESH), (STAGES_REUSED_TAG, REUSED)):
        names = [name for name, of in states.items() if of == state]
        client.set_tag(parent_id, tag, f"{len(names)}: {', '.join(names)}"[:MOST_TAG_LETTERS])
    fresh = [stage for stage in stages if states[stage.name] == FRESH]
    counts = {"stages.run": float(len(fresh)), "stages.reused": float(len(stages) - len(fresh))}
    cost = [stage.durations["cpu_seconds"] for stage in fresh if "cpu_seconds" in stage.durations]
    _log(client, parent_id, {}, counts | ({"stages.cpu_seconds": sum(cost)} if cost else {}), origin)


def _log_data(client: MlflowClient, run_id: str, versions: Mapping[str, Mapping[str, str]]) -> None:
    """Name data sets with DVC's hashes.

    Args:
        versions: context -> path -> hash.
    """
    from mlflow.entities import Dataset, DatasetInput, InputTag

    datasets = [
        DatasetInput(
            Dataset(path, text, "dvc", json.dumps({"path": path, "md5": text})),
            [InputTag("mlflow.data.context", context)],
        )
        for context, content in versions.items()
        for path, text in sorted(content.items())
    ]
    for begin in range(0, len(datasets), MOST_DATA):
        client.log_inputs(run_id, datasets=datasets[begin : begin + MOST_DATA])


def _log_curve(
    client: MlflowClient, run_id: str, prefix: str, curve: Iterable[Mapping[str, float]], origin: Origin
) -> None:
    from mlflow.entities import Metric

    # One millisecond per step, as MLflow first draws a curve over time. The key is not that of the final figure.
    points = [
        Metric(f"{prefix}.{name}", float(row[name]), origin.milliseconds + int(row["step"]), int(row["step"]))
        for row in curve
        for name in sorted(row)
        if name != "step"
    ]
    for begin in range(0, len(points), MOST_METRICS):
        client.log_batch(run_id, metrics=points[begin : begin + MOST_METRICS])


def _first_run(client: MlflowClient, home: str, condition: str) -> Run | None:
    found = client.search_runs([home], condition, max_results=1, order_by=["attributes.start_time ASC"])
    return found[0] if found else None


def _delete_unfinished(client: MlflowClient, home: str) -> None:
    unfinished = f"attributes.status = 'RUNNING' and tags.`{KIND_TAG}` = 'result'"
    for run in client.search_runs([home], unfinished):
        for nested in client.search_runs([home], f"tags.mlflow.parentRunId = '{run.info.run_id}'", max_results=50000):
            client.delete_run(nested.info.run_id)
        client.delete_run(run.info.run_id)


def _log(
    client: MlflowClient, run_id: str, parameters: Mapping[str, Any], metrics: Mapping[str, float], origin: Origin
) -> None:
    from mlflow.entities import Metric, Param

    params = [Param(key, str(parameters[key])) for key in sorted(parameters)]
    values = [Metric(key, metrics[key], origin.milliseconds, 0) for key in sorted(metrics)]
    for begin in range(0, len(params), MOST_PARAMETERS):
        client.log_batch(run_id, params=params[begin : begin + MOST_PARAMETERS])
    for begin in range(0, len(values), MOST_METRICS):
        client.log_batch(run_id, metrics=values[begin : begin + MOST_METRICS])
