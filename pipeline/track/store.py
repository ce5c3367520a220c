"""Writing records to MLflow: one parent run per distinct result, one nested run per stage."""

from __future__ import annotations

import os
import sqlite3
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.writing import whole_file
from pipeline.track.record import Record, StageRecord

if TYPE_CHECKING:
    from mlflow.entities import Run
    from mlflow.tracking import MlflowClient

KIND_TAG, KEY_TAG, STAGE_TAG = "record.kind", "record.key", "dvc.stage"
FINGERPRINT_TAG, STATE_TAG, FIRST_RUN_TAG = "dvc.stage_fingerprint", "dvc.stage_state", "dvc.first_run_id"
FRESH, REUSED = "fresh", "reused"
LOCK_SECONDS = 10.0  # how long a busy database is waited for
MOST_PARAMETERS, MOST_METRICS = 100, 900  # MLflow's limits of one batch are 100 and 1000
MOST_PARAMETER_LETTERS = 6000


def check_database(database: Path) -> None:
    """Check that the database, if there is one, can be written now; MLflow itself would retry for minutes.

    Raises:
        UserError: it is locked, read-only, or no database.
    """
    if not database.exists():
        return
    try:
        with closing(sqlite3.connect(database, timeout=LOCK_SECONDS, isolation_level=None)) as connection:
            connection.execute("BEGIN IMMEDIATE")
            connection.execute("ROLLBACK")
    except sqlite3.Error as error:
        raise _explained(database, str(error)) from error


def _explained(database: Path, text: str) -> UserError:
    if "locked" in text:
        mend = "another program is writing to it; stop that program or wait, then run `dvc repro` again"
    elif "disk is full" in text:
        mend = "the disk is full; free some space and run `dvc repro` again"
    elif "readonly" in text or "unable to open" in text:
        mend = "it cannot be written; make it and its folder writable (chmod u+w) and run `dvc repro` again"
    elif "not a database" in text or "malformed" in text:
        mend = "it is damaged; move it away and run `dvc repro` again to begin a new record"
    else:
        mend = f"{' '.join(text.split())[:300]}; run `dvc repro` again, or move the file away to begin a new record"
    return UserError(f"MLflow's database {database} cannot be used: {mend}.")


@contextmanager
def _database_errors(database: Path) -> Iterator[None]:
    from mlflow.exceptions import MlflowException
    from sqlalchemy.exc import SQLAlchemyError

    try:
        yield
    except (MlflowException, SQLAlchemyError) as error:
        raise _explained(database, str(error)) from error


def open_client(root: Path) -> MlflowClient:
    """Return a client of the database in ``root``, which is created (in some seconds) when there is none.

    Raises:
        UserError: the database cannot be used.
    """
    database = root / paths.TRACKING_DATABASE
    check_database(database)
    os.environ["MLFLOW_DISABLE_TELEMETRY"] = os.environ["DO_NOT_TRACK"] = "true"
    os.environ.setdefault("GIT_PYTHON_REFRESH", "quiet")
    import logging

    from mlflow.tracking import MlflowClient

    for name in ("alembic", "mlflow.store.db.utils"):
        logging.getLogger(name).setLevel(logging.WARNING)
    with _database_errors(database):
        if not database.exists():
            # Made aside: MLflow refuses a database that a kill or a full disk left half-made, for ever.
            with whole_file(database) as temporary:
                MlflowClient(tracking_uri=f"sqlite:///{temporary}")
        return MlflowClient(tracking_uri=f"sqlite:///{database}")


def experiment_id(client: MlflowClient, name: str, root: Path) -> str:
    """Return the id of the experiment, made with its artifacts in ``root``.

    Raises:
        UserError: the experiment keeps its artifacts elsewhere, since the repository was moved or copied.
    """
    location = (root / paths.TRACKING_ARTIFACTS).as_uri()
    known = client.get_experiment_by_name(name)
    if known is None:
        return str(client.create_experiment(name, artifact_location=location))
    if known.artifact_location != location:
        raise UserError(
            f"the MLflow experiment {name!r} in {root / paths.TRACKING_DATABASE} keeps its files in "
            f"{known.artifact_location}, as the repository was moved or copied; move it back, or move "
            f"{paths.TRACKING_DATABASE} away to begin a new record."
        )
    if known.lifecycle_stage == "deleted":
        client.restore_experiment(known.experiment_id)
    return str(known.experiment_id)


def write_record(
    root: Path, experiment: str, record: Record, tags: Mapping[str, str], artifacts: Iterable[Path]
) -> bool:
    """Record one result and return True, or return False when it is recorded already.

    A parent run counts once it is finished; what an interrupted recording left behind is deleted first.

    Args:
        root: the repository; the database and the artifacts lie in it.
        tags: of the parent run, such as versions and the git commit.
        artifacts: files to keep with the parent run.

    Raises:
        UserError: the database or the artifact folder cannot be used.
    """
    client = open_client(root)
    with _database_errors(root / paths.TRACKING_DATABASE):
        home = experiment_id(client, experiment, root)
        _delete_unfinished(client, home)
        if _first_run(client, home, f"tags.`{KEY_TAG}` = '{record.key}'"):
            return False
        parent = client.create_run(
            home, run_name=record.key[:12], tags={**tags, KIND_TAG: "result", KEY_TAG: record.key}
        )
        _log(client, parent.info.run_id, record.parameters, record.metrics)
        for artifact in artifacts:
            client.log_artifact(parent.info.run_id, str(artifact))
        for stage in record.stages:
            _write_stage(client, home, parent.info.run_id, stage)
        client.set_terminated(parent.info.run_id)
    return True


def _write_stage(client: MlflowClient, home: str, parent_id: str, stage: StageRecord) -> None:
    fingerprint = f"tags.`{FINGERPRINT_TAG}` = '{stage.fingerprint}' and tags.`{STATE_TAG}` = '{FRESH}'"
    first = _first_run(client, home, fingerprint)
    tags = {
        "mlflow.parentRunId": parent_id,
        KIND_TAG: "stage",
        STAGE_TAG: stage.name,
        FINGERPRINT_TAG: stage.fingerprint,
        STATE_TAG: REUSED if first else FRESH,
    }
    if first:
        tags[FIRST_RUN_TAG] = first.info.run_id
    run = client.create_run(home, run_name=stage.name, tags=tags)
    # A reused stage cost this result nothing: its durations stay with the run that paid for them.
    metrics = stage.metrics if first else {**stage.metrics, **stage.durations}
    _log(client, run.info.run_id, stage.parameters, metrics)
    if not first:
        _log_curve(client, run.info.run_id, stage.curve)
    client.set_terminated(run.info.run_id)


def _log_curve(client: MlflowClient, run_id: str, curve: Sequence[Mapping[str, float]]) -> None:
    from mlflow.entities import Metric

    now = int(1000 * time.time())
    points = [
        Metric(f"curve.{name}", float(row[name]), now, int(row["step"]))  # another key than the final figure's
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


def _log(client: MlflowClient, run_id: str, parameters: Mapping[str, Any], metrics: Mapping[str, float]) -> None:
    from mlflow.entities import Metric, Param

    now = int(1000 * time.time())
    params = [Param(key, str(parameters[key])[:MOST_PARAMETER_LETTERS]) for key in sorted(parameters)]
    values = [Metric(key, metrics[key], now, 0) for key in sorted(metrics)]
    for begin in range(0, len(params), MOST_PARAMETERS):
        client.log_batch(run_id, params=params[begin : begin + MOST_PARAMETERS])
    for begin in range(0, len(values), MOST_METRICS):
        client.log_batch(run_id, metrics=values[begin : begin + MOST_METRICS])
