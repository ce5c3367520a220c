"""A grasp of three objects that was found by the pipeline, carried out by the robot."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import trimesh

from pipeline.evaluate.sequence import ORDINALS
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.several import SeveralParameters, read_sequence
from pipeline.records.tables import JOINED_TRIALS, read_table, write_table
from pipeline.several.trials import TrialInput, run_trial, standing_pose, trial_inputs
from tests.evaluate.conftest import prepared

HERE = Path(__file__).parent
SETTINGS = EvaluateParameters(lift_height=0.36)


@pytest.fixture(scope="module")
def sequence() -> SeveralParameters:
    return read_sequence(HERE.parents[1] / "conf" / "several" / "three.yaml")


@pytest.fixture(scope="module")
def inputs(sequence: SeveralParameters) -> TrialInput:
    shapes = []
    for pick in sequence.picks:
        width, _, height = pick.shape.extents
        mesh = trimesh.creation.box([width, width, height])
        if pick.shape.recipe == "cylinder":
            mesh = trimesh.creation.cylinder(width / 2, height, sections=64)
        shapes.append(prepared(pick.name, mesh))
    table = pd.DataFrame([json.loads((HERE / "grasp.json").read_text())])
    return trial_inputs(table, tuple(shapes), sequence, SETTINGS, PhysicsParameters())[0]


@pytest.fixture(scope="module")
def row(inputs: TrialInput) -> dict[str, Any]:
    return run_trial(inputs)


def test_three_objects_are_lifted_one_after_the_other_and_held(row: dict[str, Any], sequence) -> None:
    assert row["reason"] == "" and row["success"] and row["phase"] == "hold"
    assert min(row["heights"]) >= SETTINGS.success_height
    phases = row["snapshot_phases"]
    assert phases == [
        "settle",
        *(f"{name} {ordinal}" for ordinal in ORDINALS[:3] for name in ("open", "approach", "enter", "close", "lift")),
        "hold",
    ]
    for number, poses in enumerate(row["snapshot_poses"]):
        heights = dict(zip(phases, [pose[2] for pose in poses], strict=True))
        rest = standing_pose(sequence.picks[number], _object(row, number), SETTINGS, np.zeros(3))[2, 3]
        assert heights[f"enter {ORDINALS[number]}"] == pytest.approx(rest, abs=3e-3)  # it stands until its pick
        assert heights[f"lift {ORDINALS[number]}"] > rest + 0.09


def _object(row: dict[str, Any], number: int):
    sizes = {"cube": [0.042] * 3, "puck": [0.036, 0.036, 0.03], "tin": [0.04, 0.04, 0.036]}
    return prepared("stand-in", trimesh.creation.box(sizes[row["objects"][number]]))


def test_row_fits_the_table(row: dict[str, Any], tmp_path) -> None:
    assert set(row) == set(JOINED_TRIALS.names)
    write_table(tmp_path / "trials.parquet", pd.DataFrame([row], columns=JOINED_TRIALS.names), JOINED_TRIALS)
    back = read_table(tmp_path / "trials.parquet", JOINED_TRIALS, "several").iloc[0]
    assert back["heights"].tolist() == row["heights"] and len(back["snapshot_poses"]) == 3


def test_a_finger_that_does_not_close_loses_its_object_alone(inputs: TrialInput) -> None:
    grasp = inputs.grasps[0]
    middle = slice(4, 8)
    q, squeeze_q = grasp.q.copy(), grasp.squeeze_q.copy()
    q[middle] = squeeze_q[middle] = grasp.picks[1].open_q[middle]
    row = run_trial(replace(inputs, grasps=(replace(grasp, q=q, squeeze_q=squeeze_q),)))
    assert (row["reason"], row["phase"]) == ("second slip", "lift second")
    assert row["heights"][0] > 0.15 and row["heights"][1] < 0.05
