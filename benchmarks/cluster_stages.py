"""Wall time of whole stages on one and on two Dask workers: `python benchmarks/cluster_stages.py [STAGE ...]`.

Needs a finished run, of which a copy is worked on: every stage computes all its items again, with one worker and with
two, on a Dask cluster of its own, whose start (some seconds) counts. Prints a table, and whether the bytes are those of
the run.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parent.parent
COMMANDS = {
    "prepare": ["pipeline.prepare"],
    "synthesize@pinch": ["pipeline.synthesize", "--style", "pinch"],
    "synthesize@side": ["pipeline.synthesize", "--style", "side"],
    "validate@pinch": ["pipeline.validate", "--style", "pinch"],
    "validate@side": ["pipeline.validate", "--style", "side"],
    "merge": ["pipeline.merge"],
    "sample@learned": ["pipeline.sample", "--source", "learned"],
    "evaluate@synthesized": ["pipeline.evaluate", "--source", "synthesized"],
    "evaluate-conditions": ["pipeline.evaluate.conditions"],
    "capture": ["pipeline.capture"],
    "reconstruct": ["pipeline.reconstruct"],
}
OUTPUTS = {
    "sample@learned": "sample/learned",
    "evaluate-conditions": "evaluate/conditions",
}


def digest(folder: Path) -> str:
    """Return a digest of all files below a folder."""
    hashed = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            hashed.update(path.relative_to(folder).as_posix().encode() + path.read_bytes())
    return hashed.hexdigest()


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("stages", nargs="*", metavar="STAGE", help="all when left out")
    stages = parser.parse_args().stages or list(COMMANDS)
    with tempfile.TemporaryDirectory() as temporary:
        copy = Path(temporary) / "copy"
        names = ["pipeline", "hands", "data", "models", "params.yaml", "code.yaml", "dvc.yaml", "constraints.txt"]
        for name in names:
            source = ROOT / name
            (shutil.copytree if source.is_dir() else shutil.copy)(source, _made(copy / name))
        parameters = yaml.safe_load((copy / "params.yaml").read_text())

        def seconds(stage: str, workers: int) -> float:
            parameters["compute"] = {"backend": "dask", "address": "", "workers": workers}
            (copy / "params.yaml").write_text(yaml.safe_dump(parameters, sort_keys=False))
            environment = os.environ | {"PYTHONPATH": str(copy), "RECOMPUTE": "1"}
            begin = time.perf_counter()
            command = [sys.executable, "-m", *COMMANDS[stage]]
            subprocess.run(command, cwd=copy, env=environment, check=True, capture_output=True)
            return time.perf_counter() - begin

        print("| stage | one worker, s | two, s | speed-up | bytes |\n|---|---|---|---|---|")
        for stage in stages:
            folder = copy / "data" / OUTPUTS.get(stage, stage.replace("@", "/"))
            before = digest(folder)
            one, two = seconds(stage, 1), seconds(stage, 2)
            same = "equal" if digest(folder) == before else "OTHER"
            print(f"| `{stage}` | {one:.1f} | {two:.1f} | {one / two:.2f} | {same} |", flush=True)


def _made(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


if __name__ == "__main__":
    main()
