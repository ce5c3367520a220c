"""Trials under other conditions: the same grasps, seeds and random numbers as the standard ones."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from pipeline.evaluate.conditions import inputs_of_series, pairs_of, sections, series_to_run
from pipeline.evaluate.inputs import inputs_of
from pipeline.evaluate.scene import placement_offsets
from pipeline.records import paths
from pipeline.records.objects import write_prepared_object
from pipeline.records.parameters import load_parameters
from pipeline.records.parameters.conditions import Condition, overridden, under
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.series import TrialSeries, series_of
from pipeline.records.tables import MERGED, write_table
from tests.evaluate.conftest import HAND


def test_sections_exist_in_the_committed_parameters(repository: Path) -> None:
    assert set(load_parameters(sections(), repository / "params.yaml")) == set(sections())


@pytest.mark.parametrize(
    ("series", "sentence"),
    [
        ("synthesized-windy-sapien", "there is no series 'synthesized-windy-sapien' under `conditions`"),
        ("synthesized-paper-sapien", "there is no series 'synthesized-paper-sapien'"),  # they are the standard trials
        ("synthesized-mu_0_5-sapien", "data/prepare/cube/object.json is missing; delete the folder and run `dvc"),
    ],
)
def test_bad_input_is_one_sentence(run_module, tmp_path, repository, series, sentence) -> None:
    (tmp_path / "params.yaml").write_text((repository / "params.yaml").read_text())
    environment = os.environ | {"PYTHONPATH": str(repository)}
    done = run_module("pipeline.evaluate.conditions", "--series", series, folder=tmp_path, env=environment)
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


def test_one_friction_is_that_of_every_two_materials() -> None:
    _, physics = under(Condition(friction=0.4), "sapien", EvaluateParameters(), PhysicsParameters())
    materials = {name: value for name, value in dict(physics).items() if "friction" in name}
    assert len(materials) == 5 and set(materials.values()) == {0.4}  # so that the mean of any two is 0.4 as well


def test_what_is_drawn_holds_in_any_engine() -> None:
    """MuJoCo refuses the standard materials, which the draw replaces."""
    for condition in (Condition(drawn=True), Condition(friction=0.5)):
        assert under(condition, "mujoco", EvaluateParameters(), PhysicsParameters())[1].engine == "mujoco"
    with pytest.raises(ValueError, match="MuJoCo has one friction coefficient"):
        under(Condition(), "mujoco", EvaluateParameters(), PhysicsParameters())


def test_series_are_named_by_source_condition_and_engine() -> None:
    series = TrialSeries("learned", "mu_0_5", "sapien")
    assert series_of(str(series)) == series
    assert [series_of(name) for name in ("learned", "guessed-mu_0_5-sapien", "a-b-c-d")] == [None] * 3


def test_every_source_runs_under_every_condition_that_is_not_the_standard(repository: Path) -> None:
    parameters = load_parameters(sections(), repository / "params.yaml")
    conditions, found = parameters["conditions"], series_to_run(parameters)
    names = {series.condition for series in found.values()}
    assert names == {name for name, one in conditions.settings.items() if one.engines in (None, ["sapien"])} - {"paper"}
    assert len(found) == len(conditions.sources) * len(names)
    without_photos = series_to_run({**parameters, "reconstructed": {}})
    assert {name: series for name, series in found.items() if series.source != "reconstructed"} == without_photos
    photographed = pairs_of(TrialSeries("reconstructed", "mu_0_5", "sapien"), parameters)
    sides = {first: item.side for first, item in parameters["reconstructed"].items()}
    assert photographed == [(first, second) for first, side in sides.items() for second in side]
    assert pairs_of(TrialSeries("learned", "mu_0_5", "sapien"), parameters) == list(conditions.pairs)


def test_a_wider_placement_stretches_the_same_offsets() -> None:
    standard = EvaluateParameters(perturbation=0.005, yaw_perturbation=0.1)
    wider = overridden(standard, {"perturbation": 0.01, "yaw_perturbation": 0.2})
    offsets = [placement_offsets(2, settings, np.random.default_rng(3)) for settings in (standard, wider)]
    np.testing.assert_allclose(offsets[1], 2 * offsets[0])


def test_fewer_trials_are_the_first_of_the_standard_ones(tmp_path, repository, monkeypatch, objects, grasp_row) -> None:
    monkeypatch.chdir(tmp_path)
    values = yaml.safe_load((repository / "params.yaml").read_text())
    values["evaluate"]["trials"] = 6
    values["conditions"] |= {"pairs": [["cube", "slender_cylinder"]], "trials": 2}
    Path("params.yaml").write_text(yaml.safe_dump(values))
    for prepared in objects:
        write_prepared_object(paths.prepared_folder(prepared.name), prepared)
    names = {"rejected_by": "", "object_clearance": 0.03}
    rows = [
        dict.fromkeys(MERGED.names) | grasp_row | names | {"merged_id": i, "hand_clearance": 0.001 * i}
        for i in range(9)
    ]
    write_table(paths.merged_file("cube"), pd.DataFrame(rows, columns=MERGED.names), MERGED)
    parameters = load_parameters(sections())
    strong = inputs_of_series("synthesized-simulator_torque-sapien/cube/slender_cylinder", parameters, HAND)
    drawn = inputs_of_series("synthesized-distribution-sapien/cube/slender_cylinder", parameters, HAND)
    parameters = load_parameters(["seed", "styles", "picks", "physics", "evaluate"])
    standard = inputs_of("synthesized", ("cube", "slender_cylinder"), parameters, HAND)[:2]
    for one, other, third in zip(strong, standard, drawn, strict=True):
        assert (one.trial, one.seed) == (other.trial, other.seed) == (third.trial, third.seed)
        assert [grasp.merged_id for grasp in one.grasps] == [grasp.merged_id for grasp in other.grasps]
        assert (one.physics.hand_torque_limit, other.physics.hand_torque_limit) == (50.0, 0.7)
        assert one.distribution is None is other.distribution and third.distribution is not None
