"""Trials under other conditions beside the standard ones: counted, compared one to one, explained."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pipeline.records.parameters.conditions import Condition, DistributionParameters
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.report.charts import Link
from pipeline.report.conditions import (
    Conditions,
    changes_of,
    conditions_section,
    conditions_summary,
    pairs_table,
    reasons_of,
    success_table,
)
from pipeline.report.distribution import drawn_quantities, effect, effects
from pipeline.report.meanings import TRIALS
from pipeline.report.wording import percent, spoken, trials_key
from tests.report import made_up

RANGES = DistributionParameters()


def test_trials_are_compared_with_the_standard_ones_of_the_same_pair_and_number():
    # Standard: numbers 0 of both pairs succeed. Here: number 0 of the box fails, number 2 of the can succeeds.
    one = made_up.tried("cube", ["can", "box"])
    assert one.trials == 6 and (one.lost, one.gained) == (1, 1)
    assert [pair.successes for pair in one.pairs] == [2, 0]
    assert [pair.successes for pair in one.standard] == [1, 1]
    assert reasons_of(one.pairs) == {"dropped in hold": 1, "first slip": 1, "plan second": 2}


def test_standard_trials_that_were_not_repeated_do_not_count():
    one = made_up.tried("cube", ["can", "box"], numbers=1)
    assert one.trials == 2
    assert [pair.trials for pair in one.standard] == [1, 1]
    assert (one.lost, one.gained) == (1, 0)


def test_figures_of_a_series():
    values = conditions_summary([made_up.tried("cube", ["can", "box"])])
    prefix = "evaluate.conditions.icy.sapien.synthesized."
    own = {key.removeprefix(prefix): value for key, value in values.items()}
    assert own["success_rate_mean"] == pytest.approx((2 / 3 + 0) / 2) and own["success_rate_min_pair"] == 0
    assert own["success_rate_mean_10cm"] == pytest.approx((2 / 3 + 1 / 3) / 2)
    assert own["standard_success_rate_mean"] == pytest.approx(1 / 3)
    assert own["lost"] == own["gained"] == pytest.approx(1 / 6)
    assert own["planning_failure_rate"] == pytest.approx(1 / 3)
    assert own["cube--can.success_rate"] == pytest.approx(2 / 3)
    assert conditions_summary([]) == {}


def test_what_a_condition_changes_is_said_with_the_standard_value():
    condition = Condition(evaluate={"perturbation": 0.01}, friction=0.6)
    standard = EvaluateParameters(perturbation=0.004)
    first, second, *others = changes_of("slippery", condition, RANGES, standard, PhysicsParameters())
    assert (first.name, first.standard, first.here) == ("evaluate.perturbation", "0.004", "0.01")
    assert first.meaning == EvaluateParameters.model_fields["perturbation"].description
    assert (second.name, second.standard, second.here) == ("physics.object_friction", "0.9", "0.6")
    assert {change.here for change in others} == {"0.6"} and len(others) == 4  # tips, links and what things stand on
    drawn = changes_of("drawn", Condition(drawn=True), RANGES, standard, PhysicsParameters())
    assert [change.name for change in drawn] == [f"conditions.distribution.{key}" for key in dict(RANGES)]


def test_the_table_has_a_row_per_source_and_a_column_per_condition_and_engine():
    one = made_up.tried("cube", ["can", "box"])
    other = replace(made_up.tried("cube", ["can"]), is_standard=True)
    table = success_table([one, other])
    assert table.headers == ["grasps", "icy, sapien"] and len(table.rows) == 1
    table = pairs_table("synthesized", [one])
    assert table.rows[0][1] == Link("2 of 3", trials_key("synthesized-icy-sapien", "cube", "can"))
    assert pairs_table("synthesized", [other]).rows[0][1].target == trials_key("synthesized", "cube", "can")


def test_the_section_shows_rates_and_every_reason():
    one = made_up.tried("cube", ["can", "box"])
    html = conditions_section(Conditions([one], made_up.CHANGES), "20 cm, 2 s", 0.7)
    # 2 of 6 trials; the interval is Wilson's, by hand.
    assert f"{percent(1 / 3)} (9.7–70.0 %; worst pair {percent(0)})" in html
    assert all(TRIALS[reason] in html for reason in reasons_of(one.pairs))


def test_a_row_without_its_standard_trial_is_refused():
    rows = made_up.trials("cube", ["can"])
    with pytest.raises(pd.errors.MergeError):
        made_up.tried("cube", ["can"], standard=pd.concat([rows, rows]))


def test_thirds_of_a_quantity_and_how_well_it_separates():
    values = np.array([0.9, 0.3, 0.8, 0.4, 0.7, 0.5])
    found = effect("friction", values, values > 0.45)
    assert [(part.low, part.high, part.successes, part.trials) for part in found.parts] == [
        (0.3, 0.4, 0, 2),
        (0.5, 0.7, 2, 2),
        (0.8, 0.9, 2, 2),
    ]
    assert found.separation == 0  # every failed trial drew less friction than every successful one
    assert effect("friction", -values, values > 0.45).separation == 1
    tied = effect("latency", np.zeros(6), values > 0.45)
    assert [part and part.trials for part in tied.parts] == [6, None, None] and tied.separation == 0.5
    assert np.isnan(effect("friction", values, np.ones(6, bool)).separation)


def test_vectors_count_by_their_length_and_what_matters_most_comes_first():
    success = [True, False] * 6
    rows = made_up.drawn_trials([0.9 if good else 0.3 for good in success], success)
    found = drawn_quantities(rows)
    np.testing.assert_allclose(found["centre of mass off, second (mm)"], 5.0 * np.arange(12))
    np.testing.assert_allclose(found["rotation error, first (°)"], np.rad2deg(0.005 * np.arange(12)))
    np.testing.assert_allclose(found["joint error, root mean square (mrad)"], np.arange(12.0))
    assert effects(rows)[0].quantity == "friction"


def test_the_section_draws_what_a_distribution_does():
    rows = made_up.drawn_trials([0.3, 0.6, 0.9], [False, True, True])
    one = replace(made_up.tried("cube", ["can"]), rows=rows)
    html = conditions_section(Conditions([one], made_up.CHANGES), "20 cm, 2 s", 0.7)
    assert html.count("<circle") == 3 * len(drawn_quantities(rows))


def test_a_condition_is_named_by_its_number():
    assert [spoken(name) for name in ("mu_0_5", "medicine_bottle_1")] == ["mu 0.5", "medicine bottle 1"]
