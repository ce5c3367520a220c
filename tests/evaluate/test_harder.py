"""Trials in a harder setting: the same grasps, seeds and random numbers as the standard ones."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from pipeline.evaluate.harder import inputs_of_setting, sections
from pipeline.evaluate.inputs import inputs_of
from pipeline.evaluate.scene import placement_offsets
from pipeline.records import paths
from pipeline.records.objects import write_prepared_object
from pipeline.records.parameters import load_parameters
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.harder import overridden
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.tables import MERGED, write_table
from tests.evaluate.conftest import HAND


def test_sections_exist_in_the_committed_parameters(repository: Path) -> None:
    assert set(load_parameters(sections(), repository / "params.yaml")) == set(sections())


@pytest.mark.parametrize(
    ("setting", "sentence"),
    [
        ("windy", "there is no setting 'windy' under `harder.settings`"),
        ("placement", "data/prepare/cube/object.json is missing; delete the folder and run `dvc repro prepare`"),
    ],
)
def test_bad_input_is_one_sentence(run_module, tmp_path, repository, setting, sentence) -> None:
    (tmp_path / "params.yaml").write_text((repository / "params.yaml").read_text())
    environment = os.environ | {"PYTHONPATH": str(repository)}
    done = run_module("pipeline.evaluate.harder", "--setting", setting, folder=tmp_path, env=environment)
    assert done.returncode == 2 and sentence in done.stderr
    assert len([line for line in done.stderr.strip().splitlines() if "%|" not in line]) == 1  # beside the progress
    assert not list(tmp_path.rglob("*.parquet"))


def test_only_the_named_values_differ() -> None:
    standard = PhysicsParameters(object_friction=0.8)
    changed = overridden(standard, {"hand_torque_limit": 50})
    assert changed.hand_torque_limit == 50.0 and isinstance(changed.hand_torque_limit, float)
    assert changed.model_copy(update={"hand_torque_limit": standard.hand_torque_limit}) == standard
    with pytest.raises(ValueError, match="^hand_torque: unknown parameter"):
        overridden(standard, {"hand_torque": 50})


def test_a_wider_placement_stretches_the_same_offsets() -> None:
    standard = EvaluateParameters(perturbation=0.005, yaw_perturbation=0.1)
    wider = overridden(standard, {"perturbation": 0.01, "yaw_perturbation": 0.2})
    offsets = [placement_offsets(2, settings, np.random.default_rng(3)) for settings in (standard, wider)]
    np.testing.assert_allclose(offsets[1], 2 * offsets[0])


def test_fewer_trials_are_the_first_of_the_standard_ones(tmp_path, repository, monkeypatch, objects, grasp_row) -> None:
    monkeypatch.chdir(tmp_path)
    values = yaml.safe_load((repository / "params.yaml").read_text())
    values["evaluate"]["trials"] = 6
    values["harder"] |= {"pairs": [["cube", "slender_cylinder"]], "trials": 2}
    Path("params.yaml").write_text(yaml.safe_dump(values))
    for prepared in objects:
        write_prepared_object(paths.prepared_folder(prepared.name), prepared)
    names = {"rejected_by": "", "object_clearance": 0.03}
    rows = [
        dict.fromkeys(MERGED.names) | grasp_row | names | {"merged_id": i, "hand_clearance": 0.001 * i}
        for i in range(9)
    ]
    write_table(paths.merged_file("cube"), pd.DataFrame(rows, columns=MERGED.names), MERGED)
    harder = inputs_of_setting("simulator_torque/cube/slender_cylinder", load_parameters(sections()), HAND)
    parameters = load_parameters(["seed", "styles", "picks", "physics", "evaluate"])
    standard = inputs_of("synthesized", ("cube", "slender_cylinder"), parameters, HAND)[:2]
    for one, other in zip(harder, standard, strict=True):
        assert (one.trial, one.seed) == (other.trial, other.seed)
        assert [grasp.merged_id for grasp in one.grasps] == [grasp.merged_id for grasp in other.grasps]
        assert (one.physics.hand_torque_limit, other.physics.hand_torque_limit) == (50.0, 0.7)
