"""MLflow's database and the experiment in it, with one sentence for whatever is wrong with them."""

from __future__ import annotations

import fcntl
import logging
import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.writing import whole_file

if TYPE_CHECKING:
    from mlflow.tracking import MlflowClient

LOCK_SECONDS = 10.0  # how long a busy database is waited for


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
def alone(root: Path) -> Iterator[None]:
    """Wait until no other recording is under way, as of experiments that run at the same time."""
    with open(root / f"{paths.TRACKING_DATABASE}.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


@contextmanager
def database_errors(database: Path) -> Iterator[None]:
    """Turn what MLflow and SQLAlchemy raise into a :class:`UserError`."""
    from mlflow.exceptions import MlflowException
    from sqlalchemy.exc import SQLAlchemyError

    try:
        yield
    except (MlflowException, SQLAlchemyError) as error:
        raise _explained(database, str(error)) from error


@contextmanager
def server_errors(server: str) -> Iterator[None]:
    """Turn what an MLflow server, or the store of its artifacts, answers into a :class:`UserError`."""
    from mlflow.exceptions import MlflowException

    try:
        yield
    except (MlflowException, OSError) as error:
        text = " ".join(str(error).split())[:200]
        raise UserError(
            f"the MLflow server {server} cannot be used ({text}); check its address and its log."
        ) from error


def open_server(server: str) -> MlflowClient:
    """Return a client of an MLflow server.

    Raises:
        UserError: it does not answer within some seconds.
    """
    _quiet()
    os.environ["MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT"] = "true"  # two lines for every run
    os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "2")  # its own seven take minutes
    from mlflow.tracking import MlflowClient

    client = MlflowClient(tracking_uri=server)
    with server_errors(server):
        client.search_experiments(max_results=1)
    return client


def experiment_on_server(client: MlflowClient, name: str) -> str:
    """Return the id of the experiment, made with its artifacts where the server keeps them."""
    known = client.get_experiment_by_name(name)
    if known is None:
        return str(client.create_experiment(name))
    if known.lifecycle_stage == "deleted":
        client.restore_experiment(known.experiment_id)
    return str(known.experiment_id)


def _quiet() -> None:
    """Keep MLflow from telling its makers, or us, more than is needed."""
    os.environ["MLFLOW_DISABLE_TELEMETRY"] = os.environ["DO_NOT_TRACK"] = "true"
    os.environ.setdefault("GIT_PYTHON_REFRESH", "quiet")
    for name in ("alembic", "mlflow.store.db.utils"):
        logging.getLogger(name).setLevel(logging.WARNING)


def open_client(root: Path) -> MlflowClient:
    """Return a client of the database in ``root``, which is created (in some seconds) when there is none.

    Raises:
        UserError: the database cannot be used.
    """
    database = root / paths.TRACKING_DATABASE
    check_database(database)
    _quiet()
    from mlflow.tracking import MlflowClient

    with database_errors(database):
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
