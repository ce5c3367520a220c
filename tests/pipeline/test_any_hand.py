"""A hand that nobody has described: from its URDF to robot trials with two objects, without a line of code for it."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest
import yaml

from pipeline.records.tables import TRIALS, hand_of_schema, read_table
from tests.hand.five_fingers import urdf_text
from tests.pipeline.conftest import WorkingCopy

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
NEEDED = ("pipeline", "tools", "hands", "conf", "dvc.yaml", "constraints.txt", "params.yaml")
STAGES = (
    "code",
    "prepare",
    "synthesize --style pinch",
    "synthesize --style side",
    "validate --style pinch",
    "validate --style side",
    "merge",
    "evaluate --source synthesized",
)
JOINTS = 4 + 3 + 3 + 2 + 2  # the last joints of index and little finger follow others


@pytest.fixture
def project(tmp_path: Path) -> WorkingCopy:
    for name in NEEDED:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, tmp_path / name)
    (tmp_path / "five.urdf").write_text(urdf_text())
    return WorkingCopy(tmp_path)


def run(project: WorkingCopy, command: str) -> None:
    done = project.command(sys.executable, "-m", *command.split())
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"


def test_five_fingers_two_of_them_coupled_come_to_a_trial_with_two_objects(project: WorkingCopy) -> None:
    run(project, "tools.describe_hand five.urdf --name five")
    run(project, "tools.scales compose tiny --hand five --force")
    content = yaml.safe_load((project / "params.yaml").read_text())
    content["synthesize"]["pinch"] |= {"chains": 96, "iterations": 1000}
    content["synthesize"]["side"]["chains"] = 96
    content["validate"]["most_candidates"], content["merge"]["most_combinations"] = 16, 100
    (project / "params.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    for stage in STAGES:
        run(project, f"pipeline.{stage}")
    table = project / "data/evaluate/synthesized/cube.parquet"
    assert hand_of_schema(pq.read_schema(table)) == "five"
    (row,) = read_table(table, TRIALS, "evaluate@synthesized").to_dict("records")
    assert list(row["objects"]) == ["cube", "slender_cylinder"]
    assert {len(q) for q in row["snapshot_robot_q"]} == {7 + JOINTS}
    assert row["merged_id"] >= 0 and row["phase"] != "settle"  # the robot moved, for a grasp that holds both
