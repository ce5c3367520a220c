"""The commands of docs/scaling.md that start a cluster, and its script for SLURM."""

import re
import shlex
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/scaling.md").read_text()

pytest.importorskip("distributed", reason="needs the extra `cluster`")


@pytest.mark.parametrize("line", re.findall(r"^dask .*$", PAGE, re.MULTILINE))
def test_dask_understands_the_commands(line):
    from distributed.cli import dask_scheduler, dask_worker

    _, kind, *arguments = shlex.split(line)
    command = {"scheduler": dask_scheduler.main, "worker": dask_worker.main}[kind]
    given = command.make_context(kind, list(arguments)).params
    assert kind == "scheduler" or given["nthreads"] == 1  # as the physics engine needs it


def test_the_packages_of_the_extra_are_pinned():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    pinned = {line.split("==")[0] for line in (ROOT / "constraints.txt").read_text().splitlines()}
    (named,) = re.findall(r"^pip install .*\[(\w+)\]", PAGE, re.MULTILINE)
    assert {re.split(r"[>=]", item)[0] for item in extras[named]} <= pinned


def test_the_slurm_script_asks_for_the_workers_that_it_names(monkeypatch):
    """As far as it can be known without SLURM: what it would submit."""
    jobqueue = pytest.importorskip("dask_jobqueue", reason="needs the extra `cluster`")
    (script,) = re.findall(r"^```python\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
    (arguments,) = re.findall(r"SLURMCluster\((.*?)^    \)", script, re.DOTALL | re.MULTILINE)
    given = eval(f"dict({arguments})", {"sys": sys})
    given.pop("scheduler_options")
    address = "tcp://node17:8786"
    job = jobqueue.slurm.SLURMJob(scheduler=address, name="job", **given).job_script()
    assert address in job and f"--nworkers {given['processes']} " in job and "--nthreads 1 " in job
    assert f"--cpus-per-task={given['cores']}" in job and all(line in job for line in given["job_script_prologue"])
