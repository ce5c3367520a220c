"""What report and record cost for many objects, on tables that are made up.

    python benchmarks/report_many.py --objects 1000 --partners 4

Every object is grasped in both styles and picked first in ``--partners`` pairs, each tried ``--trials`` times with
synthesized and with learned grasps. The tables have the columns and about the sizes of real ones, but no trial in them
was ever made: outcomes are drawn at random, all grasps and trials of a kind look alike. Everything lies in a temporary
folder (``--folder`` keeps it), in which ``python -m pipeline.report`` and ``python -m pipeline.track`` run as they do
in the pipeline. Prints their wall and processor seconds and peak memory, the sizes of the page, the table of pairs, the
summary and the data card, and the rows of metrics, parameters and tags in MLflow's database.
"""

from __future__ import annotations

import argparse
import os
import resource
import sqlite3
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import yaml

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
from pipeline.records import paths  # noqa: E402
from pipeline.records.flat import PAIR_GRASPS, PAIR_TRIALS, stored  # noqa: E402
from pipeline.records.objects import write_mesh  # noqa: E402
from pipeline.records.parameters import read_parameters  # noqa: E402
from pipeline.records.sources import OF_ALL_PAIRS  # noqa: E402
from pipeline.records.tables import CANDIDATES, VALIDATED, write_table  # noqa: E402
from pipeline.records.writing import write_json  # noqa: E402
from tests import pairs  # noqa: E402
from tests.report import made_up  # noqa: E402

CHAINS = 192
ACCEPTED, REJECTED = 40, 20  # combinations of a pair
REASONS = ("plan second", "first slip", "second slip", "dropped in hold")
PHASES = ("settle", "close first", "first lift", "open", "approach", "close second", "lift", "hold")
# As dvc.yaml declares them: sections of params.yaml, and outputs.
STAGES = {
    "prepare": (["objects", "meshes", "prepare"], "data/prepare"),
    "synthesize@pinch": (["hand", "seed", "styles", "synthesize"], "data/synthesize/pinch"),
    "synthesize@side": (["hand", "seed", "styles", "synthesize"], "data/synthesize/side"),
    "validate@pinch": (["hand", "styles", "physics", "validate"], "data/validate/pinch"),
    "validate@side": (["hand", "styles", "physics", "validate"], "data/validate/side"),
    "merge": (["seed", "styles", "pairs", "physics", "validate", "merge"], "data/merge"),
    "train": (["seed", "styles", "pairs", "train"], "models/train"),
    "sample@learned": (["seed", "styles", "pairs", "train", "merge", "physics", "validate"], "data/sample/learned"),
    "evaluate@synthesized": (["seed", "styles", "pairs", "physics", "evaluate"], "data/evaluate/synthesized"),
    "evaluate@learned": (["seed", "styles", "pairs", "physics", "evaluate"], "data/evaluate/learned"),
    "report": ([], "reports/index.html"),
}


def write_parameters(count: int, partners: int, trials: int) -> list[str]:
    """Write params.yaml of boxes of different sizes and return their names."""
    content: dict[str, Any] = yaml.safe_load((ROOT / "params.yaml").read_text())
    names = [f"object_{index:04d}" for index in range(count)]
    box = content["objects"]["cube"]
    content["objects"] = {name: {**box, "extents": _extents(index)} for index, name in enumerate(names)}
    content["styles"] = {"pinch": names, "side": names}
    content |= {"pairs": partners, "meshes": {}, "renderings": {}, "captures": {}, "reconstructed": {}}
    content["conditions"] = {**content["conditions"], "pairs": [], "settings": {}}
    content["evaluate"]["trials"] = trials
    paths.PARAMETERS_FILE.write_text(yaml.safe_dump(content, sort_keys=False))
    return names


def _extents(index: int) -> list[float]:
    return [0.03 + 0.0005 * (index % 40), 0.04, 0.05 + 0.001 * (index % 50)]


def write_objects(names: list[str]) -> None:
    """Write the meshes and facts of all objects."""
    import trimesh

    for index, name in enumerate(names):
        extents = _extents(index)
        folder = paths.prepared_folder(name)
        folder.mkdir(parents=True)
        solid = trimesh.creation.box(extents).subdivide().subdivide().subdivide().subdivide()
        write_mesh(folder / "mesh.ply", np.asarray(solid.vertices), np.asarray(solid.faces))
        facts = {"source": "made up", "licence": "own work, MIT"}
        write_json(folder / "object.json", {"extents": extents, "mass": 0.03, "provenance": facts})


class Template:
    """A table of which only some columns differ from file to file."""

    def __init__(self, rows: pd.DataFrame, schema: pa.Schema) -> None:
        with tempfile.TemporaryDirectory() as folder:
            write = write_table if stored(schema) is schema else pairs.write_pairs
            write(Path(folder) / "rows.parquet", rows, schema)
            self.table = pq.read_table(Path(folder) / "rows.parquet").combine_chunks()

    def write(self, target: Path, **columns: Any) -> None:
        """Write the table with these columns instead of its own."""
        table = self.table
        for name, values in columns.items():
            at = table.schema.get_field_index(name)
            table = table.set_column(at, table.schema.field(at), pa.array(values, table.schema.field(at).type))
        target.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(table, target, compression="zstd")


def _numbered(rows: pd.DataFrame, count: int, name: str) -> pd.DataFrame:
    repeated = pd.concat([rows] * (-(-count // len(rows))), ignore_index=True).head(count)
    return repeated.assign(**{name: range(count)})


def write_singles(names: list[str], generator: np.random.Generator) -> None:
    """Write the candidates and validated grasps of all objects in both styles."""
    for style in ("pinch", "side"):
        made = Template(_numbered(made_up.candidates(style, "x"), CHAINS, "grasp_id"), CANDIDATES)
        tested = Template(_numbered(made_up.validated(style, "x"), CHAINS, "grasp_id"), VALIDATED)
        for name in names:
            quality = generator.beta(4, 2)
            filtered = np.where(generator.random(CHAINS) < 0.6, "", "force_closure")
            survived = np.where(generator.random(CHAINS) < quality, "", "gravity:-x")
            fates = np.where(filtered == "", survived, filtered)
            made.write(paths.candidates_file(style, name), object=[name] * CHAINS, rejected_by=filtered)
            tested.write(paths.validated_file(style, name), object=[name] * CHAINS, rejected_by=fates)


def write_pairs(partners: dict[str, tuple[str, ...]], trials: int, generator: np.random.Generator) -> None:
    """Write the two-object grasps, samples and trials of all pairs."""
    most = max(map(len, partners.values()))
    grasps = pd.concat([made_up.merged("a", "b", ACCEPTED + REJECTED - 1)] * most, ignore_index=True)
    grasps["gravity_drift"] = [[0.001] * 6] * len(grasps)
    tried = made_up.trials("a", ["b"]).head(1)
    for name in ("snapshot_robot_q", "snapshot_pose0", "snapshot_pose1"):
        tried[name] = [list(tried[name].iloc[0][:1]) * len(PHASES)]
    tried["snapshot_phases"] = [list(PHASES)]
    templates = {}
    for count in {len(own) for own in partners.values()}:
        rows = grasps.head(count * (ACCEPTED + REJECTED))
        templates[count] = Template(rows, PAIR_GRASPS), Template(pd.concat([tried] * (count * trials)), PAIR_TRIALS)
    quality: dict[str, dict[str, Any]] = {}
    for first, seconds in partners.items():
        merged, outcomes = templates[len(seconds)]
        size = len(seconds) * (ACCEPTED + REJECTED)
        names = [[first, second] for second in np.repeat(seconds, ACCEPTED + REJECTED)]
        for file in (paths.merged_file(first), paths.sampled_file("learned", first)):
            fates = np.tile(np.repeat(["", "hand_clearance"], [ACCEPTED, REJECTED]), len(seconds))
            used = np.stack([generator.integers(0, 60, size) for _ in (0, 1)], axis=1)
            drifts = list(np.round(generator.gamma(2.0, 0.0015, (size, 6)), 6))
            merged.write(file, objects=names, grasp_ids=list(used), rejected_by=fates, gravity_drift=drifts)
        for source in OF_ALL_PAIRS:
            chance = np.repeat(generator.beta(30, 1.5, len(seconds)), trials)
            good = generator.random(len(chance)) < chance
            outcomes.write(
                paths.trials_file(source, first),
                trial=np.tile(np.arange(trials), len(seconds)),
                source=[source] * len(good),
                objects=[[first, second] for second in np.repeat(seconds, trials)],
                success=good,
                success_10cm=good,
                reason=np.where(good, "", generator.choice(REASONS, len(good))),
            )
        quality[first] = made_up.quality(first, seconds)
    write_json(paths.sample_quality_file("learned"), quality)


def write_model() -> None:
    """Write the training's history."""
    steps = np.arange(100, 40001, 100)
    rows = pd.DataFrame({"step": steps, "training_loss": 50 / steps, "held_out_loss": 80 / steps})
    paths.MODEL_FOLDER.mkdir(parents=True)
    rows.to_csv(paths.MODEL_FOLDER / "history.csv", index=False)


def write_lock() -> None:
    """Write dvc.yaml and dvc.lock as they are after a run."""
    parameters = yaml.safe_load(paths.PARAMETERS_FILE.read_text())
    declared: dict[str, Any] = {}
    locked = {}
    for number, (stage, (sections, output)) in enumerate(STAGES.items()):
        name, _, item = stage.partition("@")
        if item:
            declared.setdefault(name, {"foreach": [], "do": {}})["foreach"].append(item)
        else:
            declared[name] = {"cmd": "x"}
        values = {section: parameters[section] for section in sections}
        locked[stage] = {
            "cmd": "x",
            "params": {"code.yaml": {name: f"{number:016x}"}, "params.yaml": values},
            "outs": [{"path": output, "md5": f"{number:032x}"}],
        }
    Path("dvc.yaml").write_text(yaml.safe_dump({"stages": declared}, sort_keys=False))
    Path("dvc.lock").write_text(yaml.safe_dump({"schema": "2.0", "stages": locked}, sort_keys=False))


def timed(module: str) -> str:
    """Run a stage's command and return what it cost."""
    begin, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    subprocess.run([sys.executable, "-m", module], env=environment, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return f"{time.perf_counter() - begin:.1f} s, {seconds:.1f} CPU s, largest process {after.ru_maxrss / 1024:.0f} MB"


def rows_of_database() -> dict[str, int]:
    """Return the number of rows that MLflow's database holds of each kind."""
    with closing(sqlite3.connect(paths.TRACKING_DATABASE)) as connection:
        return {
            name: int(connection.execute(f"SELECT count(*) FROM {name}").fetchone()[0])
            for name in ("metrics", "params", "tags")
        }


def main() -> int:
    """Parse the command line, make the tables up, run both commands, print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", type=int, default=1000)
    parser.add_argument("--partners", type=int, default=4)
    parser.add_argument("--trials", type=int, default=25)
    parser.add_argument("--folder", type=Path, help="a new folder to keep everything in")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        os.chdir(folder)
        Path("hands").symlink_to(ROOT / "hands")
        names = write_parameters(arguments.objects, arguments.partners, arguments.trials)
        generator = np.random.default_rng(1)
        write_objects(names)
        write_singles(names, generator)
        partners = read_parameters().partners()
        write_pairs(partners, arguments.trials, generator)
        write_model()
        pairs = sum(map(len, partners.values()))
        print(f"made up: {len(names)} objects, {pairs} pairs, {2 * pairs * arguments.trials} trials")
        print(f"report: {timed('pipeline.report')}")
        files = (paths.REPORT_PAGE, paths.PAIRS_TABLE, paths.SUMMARY_FILE, paths.DATASET_CARD)
        for file in files:
            print(f"  {file}: {file.stat().st_size / 1e6:.2f} MB")
        write_lock()
        print(f"track: {timed('pipeline.track')}")
        rows = rows_of_database()
        print(f"  rows: {sum(rows.values())} ({', '.join(f'{count} {name}' for name, count in rows.items())})")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
