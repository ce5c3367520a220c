"""What is removed before results are gathered, and what never is."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.records.parameters import read_parameters
from pipeline.workspace.prune import prune


@pytest.fixture
def parameters(repository):
    return read_parameters(repository / "params.yaml")  # cube, plum; slender_cylinder, soup_can


def put(*names: str) -> list[Path]:
    paths = [Path(name) for name in names]
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("x")
    return paths


def test_only_outputs_of_objects_no_longer_named_are_removed(empty_folder, parameters):
    kept = put(
        "data/prepare/cube/object.json",
        "data/synthesize/pinch/cube.parquet",
        "data/validate/side/soup_can.parquet",
        "data/validate/pinch/notes.txt",
        "data/train/plum/quality.json",
        "data/evaluate/synthesized/plum.parquet",
        "data/evaluate/learned/cube.parquet",
        "data/evaluate/harder/placement.parquet",
        "data/evaluate/harder/.gitkeep",
        "data/merge/cube/soup_can.parquet",
        "data/raw/lemon.stl",
        "data/prepare/.gitignore",
    )
    strays = put(
        "data/prepare/lemon/object.json",
        "data/synthesize/pinch/lemon.parquet",
        "data/validate/side/cube.parquet",  # cube is an object, but not held by ring and palm
        "data/evaluate/synthesized/lemon.parquet",
        "data/evaluate/learned/lemon.parquet",
        "data/evaluate/harder/windy.parquet",
        "data/evaluate/harder/cube.parquet",  # an object, but no setting
        "data/merge/lemon/soup_can.parquet",
        "data/merge/soup_can/soup_can.parquet",  # not pinched
        "data/merge/cube--soup_can.parquet",
    )
    prune(parameters)
    assert all(path.exists() for path in kept)
    assert not any(path.exists() for path in strays)
    assert not Path("data/prepare/lemon").exists()
    assert prune(parameters) == []


def test_what_killed_stages_left_is_removed_but_not_what_living_ones_write(empty_folder, parameters):
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    (dead,) = put(f"data/validate/pinch/.cube.parquet.{ended.pid}.tmp")
    put(f"data/merge/.cube.{ended.pid}.tmp/soup_can.parquet")
    (living,) = put(f"data/validate/pinch/.plum.parquet.{os.getpid()}.tmp")
    prune(parameters)
    assert not dead.exists() and not Path(f"data/merge/.cube.{ended.pid}.tmp").exists()
    assert living.exists()


def test_nothing_computed_is_nothing_to_do(empty_folder, parameters):
    assert prune(parameters) == []
