"""What is removed before anything runs, and what never is."""

import os
import subprocess
import sys
from pathlib import Path

from tools.prune import prune


def put(*names: str) -> list[Path]:
    paths = [Path(name) for name in names]
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("x")
    return paths


def test_what_killed_stages_left_is_removed_but_not_what_living_ones_write(empty_folder):
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    (dead,) = put(f"data/validate/pinch/.cube.parquet.{ended.pid}.tmp")
    put(f"data/.merge.{ended.pid}.tmp/cube.parquet", f"data/.unfinished/merge/.a1.pickle.{ended.pid}.tmp")
    (living,) = put(f"data/validate/pinch/.plum.parquet.{os.getpid()}.tmp")
    (whole,) = put("data/.unfinished/merge/a1.pickle")
    prune()
    assert not dead.exists() and not Path(f"data/.merge.{ended.pid}.tmp").exists()
    assert list(Path("data/.unfinished/merge").iterdir()) == [whole]
    assert living.exists()


def test_nothing_computed_is_nothing_to_do(empty_folder):
    assert prune() == []
