"""`benchmarks/random_edits.py`, with a few edits; many are made by hand."""

import subprocess
import sys

from tests.trust.damage import by_hand


@by_hand
def test_random_edits_end_with_the_bytes_of_a_run_from_nothing(repository, tmp_path):
    """An object's size changes; another comes while a run is killed; then back to the beginning."""
    command = [sys.executable, "benchmarks/random_edits.py", "--edits", "3", "--seed", "13"]
    done = subprocess.run(
        [*command, "--targets", "validate@pinch", "--folder", str(tmp_path / "edits")],
        cwd=repository,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "3 edits, 0 of them with differences" in done.stdout
