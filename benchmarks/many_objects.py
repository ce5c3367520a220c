"""Time `dvc repro` with nothing to do for many objects: `python benchmarks/many_objects.py --objects 1000`.

Makes up a repository with the pipeline's own dvc.yaml, a params.yaml of so many objects in both styles, and outputs as
many as their stages write, but small and of no meaning: what DVC does with them does not depend on what is in them.
Nothing is computed. Prints the number of files, the size of dvc.lock, and seconds of three runs.
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parent.parent
BYTES = 200  # of a made-up file


def fill(folder: Path, count: int, partners: int) -> None:
    """Make up the repository."""
    for name in ("pipeline", "hands"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("dvc.yaml", "constraints.txt", ".dvcignore", ".gitignore"):
        shutil.copy(ROOT / name, folder / name)
    names = [f"object_{number:05d}" for number in range(count)]
    parameters = yaml.safe_load((ROOT / "params.yaml").read_text())
    box = {"recipe": "box", "extents": [0.04, 0.04, 0.04], "up": "+z", "scale": 1.0, "density": 500.0}
    parameters |= {
        "objects": dict.fromkeys(names, box),
        "styles": {"pinch": names, "side": names},
        "pairs": partners,
        "reconstructed": {},
        "harder": {"pairs": [], "trials": 1, "settings": {}},
    }
    dumper = yaml.SafeDumper
    dumper.ignore_aliases = lambda *_: True  # type: ignore[method-assign, assignment]
    (folder / "params.yaml").write_text(yaml.dump(parameters, Dumper=dumper, sort_keys=False))

    draw = random.Random(1)
    outputs = ["data/raw/README.md", "code.yaml", "models/train/model.json", "models/train/history.csv"]
    outputs += [f"data/prepare/{name}/{file}" for name in names for file in files_of_object()]
    outputs += [
        f"data/{stage}/{style}/{n}.parquet"
        for stage in ("synthesize", "validate")
        for style in ("pinch", "side")
        for n in names
    ]
    outputs += [
        f"data/{each}/{name}.parquet"
        for each in ("merge", "sample/learned", "evaluate/synthesized", "evaluate/learned")
        for name in names
    ]
    outputs += ["data/sample/learned/quality.json", "data/sample/reconstructed/quality.json"]
    outputs += [
        "data/evaluate/reconstructed/none",
        "data/evaluate/harder/none",
        "data/capture/none",
        "data/reconstruct/none",
    ]
    outputs += [
        f"reports/{name}"
        for name in (
            "index.html",
            "figures/one.png",
            "pairs.parquet",
            "dataset.md",
            "summary.json",
            "tracking.json",
            "survival.csv",
            "success.csv",
            "learned_objectives.csv",
            "learned_ablation.csv",
        )
    ]
    stages = yaml.safe_load((folder / "dvc.yaml").read_text())["stages"]
    outputs += [out for stage in expanded(stages) for out in stage if out.startswith("data/items/")]
    for name in outputs:
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(b"{}" if target.suffix == ".json" else draw.randbytes(BYTES).hex().encode())
    subprocess.run([sys.executable, "-m", "pipeline.code"], cwd=folder, check=True, env=environment(folder))


def files_of_object() -> list[str]:
    """Return the names of the files of a prepared object."""
    return ["mesh.ply", "shapes.npz", "object.json", "picture.png"]


def expanded(stages: dict) -> list[list[str]]:
    """Return the outputs of all stages."""
    found = []
    for stage in stages.values():
        for key in stage.get("foreach", [""]):
            outs = stage.get("do", stage)["outs"]
            names = [next(iter(out)) if isinstance(out, dict) else out for out in outs]
            found.append([name.replace("${item}", key).replace("${key}", key) for name in names])
    return found


def environment(folder: Path) -> dict[str, str]:
    """Return the environment of a command in the made-up repository."""
    return os.environ | {
        "PYTHONPATH": str(folder),
        "DVC_SITE_CACHE_DIR": str(folder / ".site"),
        "DVC_NO_ANALYTICS": "1",
    }


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", type=int, default=1000)
    parser.add_argument("--partners", type=int, default=4)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        fill(folder, chosen.objects, chosen.partners)

        def run(*command: str) -> tuple[float, float, str]:
            before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
            done = subprocess.run(command, cwd=folder, env=environment(folder), capture_output=True, text=True)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            if done.returncode:
                raise SystemExit(f"{' '.join(command)}: {done.stdout}{done.stderr}")
            cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            return time.perf_counter() - begin, cpu, done.stdout

        run("git", "init", "-q")
        run("dvc", "init", "-q")
        run("dvc", "commit", "-f")
        files = sum(
            1 for name in ("data", "models", "reports") for path in (folder / name).rglob("*") if path.is_file()
        )
        print(
            f"{chosen.objects} objects, {chosen.partners} partners: {files} files, dvc.lock {(folder / 'dvc.lock').stat().st_size / 1000:.0f} kB"
        )
        for _ in range(3):
            wall, cpu, said = run("dvc", "repro")
            assert "Running stage" not in said, said
            print(f"dvc repro with nothing to do: {wall:.1f} s, CPU {cpu:.1f} s")


if __name__ == "__main__":
    main()
