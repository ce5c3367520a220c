"""What goes wrong around real DVC: a damaged cache, two runs at once, a jumping clock, a locked record.

They take minutes: `TRUST=1 ./dev test tests/pipeline/test_faults_of_runs.py`.
"""

from __future__ import annotations

import hashlib
import os
import re
import sqlite3
import subprocess
import sys
import time

import pytest

from tests.trust.damage import by_hand

pytestmark = [pytest.mark.slow, by_hand]


def test_a_damaged_cache_entry_is_found_and_made_again(finished, workspace):
    """DVC itself hands the damaged file out, without a word."""
    table = "data/validate/side/slender_cylinder.parquet"
    name = hashlib.md5((workspace / table).read_bytes()).hexdigest()
    entry = workspace / ".dvc/cache/files/md5" / name[:2] / name[2:]
    entry.unlink()  # it is a link into the cache that all copies share
    entry.write_bytes(b"spoilt")
    entry.chmod(0o444)
    (workspace / table).unlink()
    workspace.dvc("checkout", "--force", table)
    assert (workspace / table).read_bytes() == b"spoilt"
    done = workspace.command(sys.executable, "-m", "tools.check_cache")
    assert done.returncode == 1 and table in done.stdout, done.stdout + done.stderr
    result = workspace.repro()
    assert result.ran == ["validate@side"] and result.computed == {"validate@side": (1, 1)}
    assert workspace.fingerprints() == finished.fingerprints()
    done = workspace.command(sys.executable, "-m", "tools.check_cache")
    assert done.returncode == 0, done.stdout


def test_two_repros_at_once(finished, workspace, tmp_path):
    stage = "validate@side"
    with (tmp_path / "log").open("w") as log:
        first = subprocess.Popen(
            [sys.executable, "-m", "dvc", "repro", "--force", "--single-item", stage],
            cwd=workspace.root,
            stdout=log,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            env=os.environ | {"PYTHONUNBUFFERED": "1", "RECOMPUTE": "1"},
        )
        while first.poll() is None and f"Running stage '{stage}'" not in (tmp_path / "log").read_text():
            time.sleep(0.05)
        second = workspace.repro(stage, succeed=False)
        assert first.wait() == 0, (tmp_path / "log").read_text()
    assert second.ran == []
    assert re.search(r"is busy, it is being blocked by|Unable to acquire lock", second.output)
    assert workspace.repro().ran == []
    assert workspace.fingerprints() == finished.fingerprints()


@pytest.mark.parametrize("years", [-20, 20])
def test_a_clock_that_jumps_rebuilds_nothing(workspace, years):
    moment = time.time() + years * 365 * 86400
    for folder in ("data", "models", "reports", "pipeline"):
        for path in (workspace / folder).rglob("*"):
            os.utime(path, (moment, moment))
    os.utime(workspace / "params.yaml", (moment, moment))
    runs = workspace.recorded_runs()
    result = workspace.repro()
    assert result.ran == [] and result.restored == []
    assert workspace.recorded_runs() == runs


def test_a_locked_record_is_one_sentence_and_goes_on_later(workspace):
    (workspace / "reports/tracking.json").unlink()
    with sqlite3.connect(workspace / "mlflow.db", isolation_level=None) as other:
        other.execute("BEGIN EXCLUSIVE")
        result = workspace.repro(succeed=False)
        other.execute("ROLLBACK")
    assert "another program is writing to it; stop that program or wait" in result.output
    assert "Traceback" not in result.output
    runs = workspace.recorded_runs()
    assert workspace.repro().ran == ["track"]
    assert workspace.recorded_runs() == runs  # recorded before, nothing added
