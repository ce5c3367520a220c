"""Results on an MLflow server that keeps artifacts on S3: both real, on this machine alone."""

from __future__ import annotations

import os
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from pipeline.records.errors import UserError
from pipeline.track.__main__ import main
from pipeline.track.runs import KNOWN, RECORDED, Origin, write_record
from tests.share.servers import KEY, SECRET, free_port, s3
from tests.track.test_store import EXPERIMENT, record


@contextmanager
def mlflow_server(folder: Path, endpoint: str) -> Iterator[str]:
    address = ("127.0.0.1", free_port())
    access = {"AWS_ACCESS_KEY_ID": KEY, "AWS_SECRET_ACCESS_KEY": SECRET, "MLFLOW_S3_ENDPOINT_URL": endpoint}
    options = ["--host", address[0], "--port", str(address[1]), "--workers", "1"]
    options += ["--backend-store-uri", f"sqlite:///{folder}/server.db", "--artifacts-destination", "s3://grasps/mlflow"]
    with (folder / "server.log").open("w") as log:
        server = subprocess.Popen(
            ["mlflow", "server", *options], stdout=log, stderr=log, cwd=folder, env={**os.environ, **access}
        )
    url = f"http://{address[0]}:{address[1]}"
    try:
        deadline = time.monotonic() + 240
        while time.monotonic() < deadline and server.poll() is None:
            try:
                urllib.request.urlopen(f"{url}/health", timeout=5)
                break
            except (urllib.error.URLError, TimeoutError):
                time.sleep(1)
        else:
            raise RuntimeError(f"MLflow does not answer: {(folder / 'server.log').read_text()[-2000:]}")
        yield url
    finally:
        server.terminate()
        server.wait()


@pytest.mark.slow
def test_a_server_records_once_and_keeps_files_on_s3(tmp_path, monkeypatch):
    import boto3
    from mlflow.tracking import MlflowClient

    monkeypatch.setenv("HOME", str(tmp_path))
    page = tmp_path / "index.html"
    page.write_text("<p>")
    with s3(tmp_path) as (_, endpoint), mlflow_server(tmp_path, endpoint) as url:
        origin = Origin(name="first try", tags={"git.commit": "abc"}, files=[page])
        done = [write_record(tmp_path, EXPERIMENT, record(), origin, url) for _ in range(2)]
        assert done == [RECORDED, KNOWN]
        client = MlflowClient(url)
        home = client.get_experiment_by_name(EXPERIMENT)
        (parent,) = client.search_runs([home.experiment_id], "tags.`record.kind` = 'result'")
        assert parent.data.metrics["merge.grasps"] == 8.0 and len(parent.data.params) == 250
        store = boto3.client("s3", endpoint_url=endpoint, aws_access_key_id=KEY, aws_secret_access_key=SECRET)
        kept = [item["Key"] for item in store.list_objects_v2(Bucket="grasps", Prefix="mlflow").get("Contents", [])]
        assert any(key.endswith(f"{parent.info.run_id}/artifacts/index.html") for key in kept)
    assert not (tmp_path / "mlflow.db").exists()


def test_a_server_that_does_not_answer_is_one_sentence(tmp_path):
    with pytest.raises(UserError, match=r"the MLflow server http://127\.0\.0\.1:9 cannot be used"):
        write_record(tmp_path, EXPERIMENT, record(), Origin(name="x", tags={}), "http://127.0.0.1:9")


@pytest.mark.parametrize("words", [["--server", "http://127.0.0.1:9"], ["--all", "--server", "mlflow"]])
def test_a_server_is_an_address_and_goes_with_all(monkeypatch, capsys, words):
    monkeypatch.setattr("sys.argv", ["track", *words])
    with pytest.raises(SystemExit):
        main()
    assert "--server takes an address" in capsys.readouterr().err
