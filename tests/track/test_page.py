"""MLflow's own page of the recorded runs, served as `./dev ui` does, in a real browser without a network."""

import json
import shutil
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.parse
import urllib.request

import pytest

from pipeline.track import store
from pipeline.track.record import Record, StageRecord
from pipeline.track.runs import Origin, write_record
from tests.browser import needs_chromium, open_page

pytestmark = [pytest.mark.slow, pytest.mark.render, needs_chromium]
# MLflow's page asks whether there are users, and notes that its server knows none.
NO_USERS = "/ajax-api/2.0/mlflow/users/current"


def record(name: str, width: int) -> tuple[Record, Origin]:
    curve = tuple({"step": step, "loss": width / step} for step in (100.0, 200.0))
    outputs = {"models/train": f"{width:032x}.dir"}
    train = StageRecord("train", name, {"width": width}, {"loss": 0.5}, {"cpu_seconds": 80.0}, curve, {}, outputs)
    one = Record(name, {"train.width": width, "seed": 1}, {"merge.cube--soup_can.accepted": 40.0 + width}, [train])
    return one, Origin(name=name, tags={})


def free_port() -> int:
    with socket.socket() as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])


@pytest.fixture(scope="module")
def served(empty_database, tmp_path_factory):
    """The address of a server of two runs, and their identities."""
    root = tmp_path_factory.mktemp("served")
    shutil.copy(empty_database, root / "mlflow.db")
    for name, width in (("first", 256), ("smaller-network", 128)):
        write_record(root, "test", *record(name, width))
    client = store.open_client(root)
    home = client.get_experiment_by_name("test").experiment_id
    runs = client.search_runs([home], "tags.`record.kind` = 'result'", order_by=["attributes.start_time ASC"])
    port = free_port()
    command = [sys.executable, "-m", "mlflow", "server", "--host", "127.0.0.1", "--port", str(port), "--workers", "1"]
    command += ["--backend-store-uri", f"sqlite:///{root}/mlflow.db", "--default-artifact-root", f"{root}/mlartifacts"]
    with subprocess.Popen(command, cwd=root, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as server:
        try:
            wait_for(f"http://127.0.0.1:{port}/health", server)
            yield f"http://127.0.0.1:{port}/", home, [run.info.run_id for run in runs]
        finally:
            server.terminate()


def wait_for(address: str, server: subprocess.Popen) -> None:
    for _ in range(600):
        assert server.poll() is None, "the server ended"
        try:
            urllib.request.urlopen(address, timeout=5).close()
            return
        except (urllib.error.URLError, OSError):
            time.sleep(0.2)
    raise TimeoutError("the server did not start")


def test_results_are_compared_side_by_side_without_a_network(served, tmp_path):
    address, home, runs = served
    chosen = f"runs={urllib.parse.quote(json.dumps(runs))}&experiments={urllib.parse.quote(json.dumps([home]))}"
    page = open_page(
        f"{address}#/compare-runs?{chosen}",
        width=1250,
        height=1800,
        screenshot=tmp_path / "compare.png",
        ready="document.body.innerText.includes('Show diff only')",
        act="document.querySelectorAll('[role=switch]').forEach(each => each.click())",
    )
    assert [error for error in page.console_errors if NO_USERS not in error] == []
    assert [request for request in page.failed_requests if NO_USERS not in request] == []
    words = " ".join(page.text.split())
    assert "Comparing 2 Runs" in words and "first smaller-network" in words
    assert "train.width 256 128" in words and "seed" not in words  # only what differs is shown
    assert "merge.cube--soup_can.accepted train.curve.loss 296 168 1.28 0.64" in words
    assert f"dvc.data.models/train {256:032x}.dir {128:032x}.dir" in words
    assert (tmp_path / "compare.png").stat().st_size > 10_000
