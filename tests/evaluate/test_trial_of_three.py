"""A grasp of three objects that was found by the pipeline, carried out by the robot."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import trimesh

from pipeline.evaluate.grasps import grasp_from_row
from pipeline.evaluate.scene import placed
from pipeline.evaluate.trial import TrialInput, run_trial, trial_inputs
from pipeline.pairing.task import groups_of
from pipeline.records.ordinals import ORDINALS
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.picks import PickParameters
from pipeline.records.tables import TRIALS, read_table, write_table
from pipeline.stages.seeds import item_seed
from tests.evaluate.conftest import HAND
from tests.objects import prepared

SETTINGS = EvaluateParameters(lift_height=0.36)
PICKS = tuple(
    PickParameters.model_validate(pick)
    for pick in (
        {"style": "pinch", "fingers": ["thumb", "index"], "place": [0.55, 0.04]},
        {
            "style": "side",
            "objects": ["puck"],
            "fingers": ["middle", "palm"],
            "place": [0.45, -0.18],
            "post": {"width": 0.016, "height": 0.12},
        },
        {"style": "side", "objects": ["tin"], "fingers": ["ring", "palm"], "place": [0.5, 0.17]},
    )
)


@pytest.fixture(scope="module")
def inputs() -> TrialInput:
    shapes = (
        prepared("cube", trimesh.creation.box([0.042] * 3)),
        prepared("puck", trimesh.creation.cylinder(0.018, 0.03, sections=64)),
        prepared("tin", trimesh.creation.cylinder(0.02, 0.036, sections=64)),
    )
    row = json.loads((Path(__file__).parent / "grasp_of_three.json").read_text())
    grasp = grasp_from_row(row, HAND, groups_of(HAND, PICKS))
    inputs = trial_inputs("synthesized", HAND, PICKS, shapes, [grasp], SETTINGS, PhysicsParameters(), 1)[0]
    # Placement errors with which this one grasp holds; with others an object may slip.
    return replace(inputs, seed=item_seed(1, "several", "cube", "puck", "tin", 1))


@pytest.fixture(scope="module")
def row(inputs: TrialInput) -> dict[str, Any]:
    return run_trial(inputs)


def test_three_objects_are_lifted_one_after_the_other_and_held(row: dict[str, Any], inputs: TrialInput) -> None:
    assert row["reason"] == "" and row["success"] and row["phase"] == "hold"
    assert min(row["heights"]) >= SETTINGS.success_height and max(row["pushes"]) < SETTINGS.push_limit
    phases = row["snapshot_phases"]
    assert phases == [
        "settle",
        *(f"{name} {ordinal}" for ordinal in ORDINALS[:3] for name in ("open", "approach", "enter", "close", "lift")),
        "hold",
    ]
    rests = placed(PICKS, inputs.objects, SETTINGS, np.zeros((3, 3)))
    for number, (poses, T) in enumerate(zip(row["snapshot_poses"], rests, strict=True)):
        heights = dict(zip(phases, [pose[2] for pose in poses], strict=True))
        assert heights[f"enter {ORDINALS[number]}"] == pytest.approx(T[2, 3], abs=3e-3)  # it stands until its pick
        assert heights[f"lift {ORDINALS[number]}"] > T[2, 3] + 0.09


def test_row_fits_the_table(row: dict[str, Any], tmp_path) -> None:
    assert set(row) == set(TRIALS.names)
    write_table(tmp_path / "trials.parquet", pd.DataFrame([row], columns=TRIALS.names), TRIALS)
    back = read_table(tmp_path / "trials.parquet", TRIALS, "evaluate").iloc[0]
    assert back["heights"].tolist() == row["heights"] and len(back["snapshot_poses"]) == 3


def test_a_finger_that_does_not_close_loses_its_object_alone(inputs: TrialInput) -> None:
    grasp = inputs.grasps[0]
    middle, own = grasp.picks[1].joints, grasp.picks[1].open_q
    q, squeeze_q = grasp.q.copy(), grasp.squeeze_q.copy()
    q[middle] = squeeze_q[middle] = own[middle]
    row = run_trial(replace(inputs, grasps=(replace(grasp, q=q, squeeze_q=squeeze_q),)))
    assert (row["reason"], row["phase"]) == ("second slip", "lift second")
    assert row["heights"][0] > 0.15 and row["heights"][1] < 0.05
