"""Commands and script of docs/scaling.md."""

import re
import shlex
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/scaling.md").read_text()
LINES = [line for block in PAGE.split("```")[1::2] if block.startswith("\n") for line in block.splitlines()]

pytest.importorskip("distributed", reason="needs the extra `cluster`")


@pytest.mark.parametrize("line", [line for line in LINES if line.startswith("dask ")])
def test_dask_understands_the_commands(line):
    from distributed.cli import dask_scheduler, dask_worker

    _, kind, *arguments = shlex.split(line)
    command = {"scheduler": dask_scheduler.main, "worker": dask_worker.main}[kind]
    given = command.make_context(kind, list(arguments)).params
    if kind == "worker":
        assert given["nthreads"] == 1 and given["n_workers"] == "16"


def test_the_extra_is_what_the_error_and_the_page_name():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert [line for line in LINES if line.startswith("pip ")] == ["pip install -c constraints.txt -e '.[cluster]'"]
    assert {"distributed", "dask-jobqueue"} <= {re.split(r"[>=]", item)[0] for item in extras["cluster"]}
    pinned = {line.split("==")[0] for line in (ROOT / "constraints.txt").read_text().splitlines()}
    assert {re.split(r"[>=]", item)[0] for item in extras["cluster"]} <= pinned


def test_the_slurm_script_makes_a_job_of_16_workers(monkeypatch):
    """As far as it can be known without SLURM: what it would submit."""
    jobqueue = pytest.importorskip("dask_jobqueue", reason="needs the extra `cluster`")
    (script,) = re.findall(r"^```python\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
    compile(script, "docs/scaling.md", "exec")
    (arguments,) = re.findall(r"SLURMCluster\((.*?)^    \)", script, re.DOTALL | re.MULTILINE)
    given = eval(f"dict({arguments})", {"sys": __import__("sys")})
    given.pop("scheduler_options")
    job = jobqueue.slurm.SLURMJob(scheduler="tcp://node17:8786", name="job", **given).job_script()
    assert "#SBATCH -p short" in job and "#SBATCH --cpus-per-task=16" in job and "#SBATCH -t 04:00:00" in job
    assert (
        "tcp://node17:8786" in job
        and "--nthreads 1 " in job
        and "--nworkers 16 " in job
        and "OPENBLAS_CORETYPE=Haswell" in job
    )
