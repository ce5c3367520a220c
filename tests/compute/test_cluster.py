"""The same function on workers of a Dask cluster."""

import sys
import time
import warnings
from functools import partial

import numpy as np
import pytest

from pipeline.compute import likeness
from pipeline.compute.cluster import ClusterExecutor, connection
from pipeline.compute.fan_out import fan_out
from pipeline.compute.pool import run_on
from pipeline.compute.shared import Shared
from pipeline.records.errors import UserError
from pipeline.records.parameters.compute import ComputeParameters
from tests.compute.items import counting, draw, total, weighted

pytest.importorskip("distributed", reason="needs the extra `cluster`")

DASK = ComputeParameters(backend="dask", workers=2)


def threads(_: int) -> list[int]:
    import threadpoolctl

    return [found["num_threads"] for found in threadpoolctl.threadpool_info()]


def test_what_is_shared_is_sent_once_and_by_no_file(monkeypatch):
    connection("", 2)  # the cluster itself needs a temporary folder
    monkeypatch.setattr("tempfile.mkdtemp", lambda **_: 1 / 0)
    with Shared(np.arange(1000.0)) as shared:
        for _ in range(2):
            results = fan_out(partial(total, shared), list(range(8)), DASK, "totals")
            assert [value for value, *_ in results] == [499500.0 * factor for factor in range(8)]
    assert len({(identity, process) for _, identity, process, _ in results}) == len({p for _, _, p, _ in results})


def test_several_shared_values_and_further_arguments():
    with Shared(np.arange(4.0)) as first, Shared(np.ones(3)) as second:
        function = partial(weighted, first, second, 0.5, sign=-1)
        assert fan_out(function, [0, 1, 2], DASK, "weighted") == [-5.5, -8.5, -11.5]


def test_workers_drop_what_is_no_longer_shared():
    client = connection("", 2)
    begin = set(kept_by_workers(client))
    with Shared(np.arange(1000.0)) as shared:
        fan_out(partial(total, shared), list(range(8)), DASK, "totals")
        assert len(kept_by_workers(client) - begin) == 1
    deadline = time.monotonic() + 120
    while kept_by_workers(client) - begin and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not kept_by_workers(client) - begin


def kept_by_workers(client) -> set[str]:
    return {key for keys in client.has_what().values() for key in keys if str(key).startswith("shared-")}


def test_libraries_of_workers_use_one_thread():
    assert {count for counts in fan_out(threads, [0, 1], DASK, "threads") for count in counts} == {1}
    assert set(connection("", 2).nthreads().values()) == {1}  # a worker has one call at a time


def test_nothing_at_the_address_is_one_sentence(monkeypatch):
    monkeypatch.setattr("pipeline.compute.cluster.ANSWER_SECONDS", 0.5)
    nowhere = ComputeParameters(backend="dask", address="tcp://127.0.0.1:9")
    with pytest.raises(UserError, match=r"^no Dask scheduler answers at compute.address tcp://127.0.0.1:9 "):
        fan_out(draw, [1], nowhere, "nowhere")


def test_dask_that_is_not_installed_is_one_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UserError, match="distributed is not installed; run `pip install -e"):
        fan_out(draw, [1], ComputeParameters(backend="dask", workers=3), "missing")


def test_an_unlike_worker_is_refused(monkeypatch):
    """The workers of the cluster know versions as they were when they began."""
    client = connection("", 2)
    for name, said in (
        ("sapien", "sapien is .* there and 0.0 here"),
        ("the code of pipeline/", "pipeline/ is another"),
    ):
        other = likeness.circumstances() | {name: "0.0"}
        monkeypatch.setattr("pipeline.compute.cluster.circumstances", lambda other=other: other)
        with pytest.raises(UserError, match=rf"^the Dask worker tcp://\S+ would not compute the same bytes: .*{said}"):
            run_on(ClusterExecutor(client), [("unlike", lambda: counting(0, 1))], "unlike", lambda *_: None)


def test_the_code_s_fingerprint_sees_every_file(tmp_path):
    (tmp_path / "a.py").write_text("x")
    seen = {likeness.source_digest(tmp_path)}
    (tmp_path / "a.py").write_text("y")
    seen.add(likeness.source_digest(tmp_path))
    (tmp_path / "b.json").write_text("")
    seen.add(likeness.source_digest(tmp_path))
    (tmp_path / "__pycache__").mkdir()
    (tmp_path / "__pycache__" / "a.pyc").write_text("")
    seen.add(likeness.source_digest(tmp_path))
    assert len(seen) == 3


def test_an_address_without_dask_is_refused():
    with pytest.raises(ValueError, match="compute.address"):
        ComputeParameters(address="tcp://node17:8786")
    with pytest.raises(ValueError, match="address"):
        ComputeParameters(backend="dask", address="node17")


def test_no_warning_reaches_the_user():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with Shared(np.zeros(3_000_000)) as shared:  # more than what Dask calls a large graph
            fan_out(partial(total, shared), [1, 2], DASK, "large")
