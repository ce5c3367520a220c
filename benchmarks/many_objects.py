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
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parent.parent
BYTES = 200  # of a made-up file
FILES_OF_OBJECT = ("mesh.ply", "shapes.npz", "object.json", "picture.png")
REPORTS = ["index.html", "pairs.parquet", "dataset.md", "summary.json", "tracking.json", "survival.csv", "success.csv"]
REPORTS += ["learned_objectives.csv", "learned_ablation.csv"]


class PlainDumper(yaml.SafeDumper):
    """Writes what occurs several times in full each time."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def parameters_of(count: int, partners: int) -> dict[str, Any]:
    """Return parameters with so many objects in both styles."""
    names = [f"object_{number:05d}" for number in range(count)]
    box = {"recipe": "box", "extents": [0.04, 0.04, 0.04], "up": "+z", "scale": 1.0, "density": 500.0}
    return yaml.safe_load((ROOT / "params.yaml").read_text()) | {
        "objects": dict.fromkeys(names, box),
        "styles": {"pinch": names, "side": names},
        "pairs": partners,
        "reconstructed": {},
        "conditions": {"pairs": [], "trials": 1, "settings": {}},
    }


def fill(folder: Path, parameters: dict[str, Any]) -> None:
    """Make up the repository."""
    for name in ("pipeline", "hands"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("dvc.yaml", "constraints.txt", ".dvcignore", ".gitignore"):
        shutil.copy(ROOT / name, folder / name)
    (folder / "params.yaml").write_text(yaml.dump(parameters, Dumper=PlainDumper, sort_keys=False))

    firsts, styles = parameters["styles"]["pinch"], parameters["styles"]
    outputs = ["data/raw/README.md", "models/train/model.json", "models/train/history.csv"]
    outputs += [f"data/prepare/{name}/{file}" for name in parameters["objects"] for file in FILES_OF_OBJECT]
    for stage in ("synthesize", "validate"):
        outputs += [f"data/{stage}/{style}/{name}.parquet" for style, names in styles.items() for name in names]
    for stage in ("merge", "sample/learned", "evaluate/synthesized", "evaluate/learned"):
        outputs += [f"data/{stage}/{name}.parquet" for name in firsts]
    for stage in ("sample/reconstructed", "evaluate/reconstructed"):
        outputs += [f"data/{stage}/{name}.parquet" for name in parameters["reconstructed"]] or [f"data/{stage}/none"]
    outputs += ["data/sample/learned/quality.json", "data/evaluate/conditions/none", "data/capture/none"]
    outputs += ["data/reconstruct/none", "reports/figures/one.png", *(f"reports/{name}" for name in REPORTS)]
    for stage in yaml.safe_load((folder / "dvc.yaml").read_text())["stages"].values():
        for key in stage.get("foreach", [""]):
            outs = [out for out in stage.get("do", stage)["outs"] if isinstance(out, str) and "/items/" in out]
            outputs += [out.replace("${item}", key).replace("${key}", key) for out in outs]
    draw = random.Random(1)
    for name in outputs:
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(b"{}" if target.suffix == ".json" else draw.randbytes(BYTES).hex().encode())
    subprocess.run([sys.executable, "-m", "pipeline.code"], cwd=folder, check=True, env=environment(folder))


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
    parser.add_argument("--partners", type=int, default=4, help="second objects of each first one")
    parser.add_argument("--parameters", type=Path, help="a params.yaml instead, such as that of results/paper")
    chosen = parser.parse_args()
    parameters = (
        yaml.safe_load(chosen.parameters.read_text())
        if chosen.parameters
        else parameters_of(chosen.objects, chosen.partners)
    )
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        fill(folder, parameters)

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
        tops = [folder / name for name in ("data", "models", "reports")]
        files = sum(path.is_file() for top in tops for path in top.rglob("*"))
        lock = (folder / "dvc.lock").stat().st_size / 1000
        print(f"{len(parameters['objects'])} objects: {files} files, dvc.lock {lock:.1f} kB")
        for _ in range(3):
            wall, cpu, said = run("dvc", "repro")
            assert "Running stage" not in said, said
            print(f"dvc repro with nothing to do: {wall:.1f} s, CPU {cpu:.1f} s")


if __name__ == "__main__":
    main()
