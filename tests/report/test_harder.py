"""Harder settings beside the standard trials: counted, compared one to one, explained."""

import pandas as pd
import pytest

from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.harder import HarderSetting
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.report.harder import changes_of, harder_section, harder_summary, reasons_of
from pipeline.report.meanings import TRIALS
from pipeline.report.wording import percent
from tests.report import made_up


def test_trials_are_compared_with_the_standard_ones_of_the_same_pair_and_number():
    # Standard: numbers 0 of both pairs succeed. Here: number 0 of the box fails, number 2 of the can succeeds.
    one = made_up.harder("cube", ["can", "box"])
    assert one.trials == 6 and (one.lost, one.gained) == (1, 1)
    assert [pair.successes for pair in one.pairs] == [2, 0]
    assert [pair.successes for pair in one.standard] == [1, 1]
    assert reasons_of(one.pairs) == {"dropped in hold": 1, "first slip": 1, "plan second": 2}


def test_standard_trials_that_the_setting_did_not_repeat_do_not_count():
    one = made_up.harder("cube", ["can", "box"], numbers=1)
    assert one.trials == 2
    assert [pair.trials for pair in one.standard] == [1, 1]
    assert (one.lost, one.gained) == (1, 0)


def test_a_setting_s_figures():
    values = harder_summary([made_up.harder("cube", ["can", "box"])])
    own = {key.removeprefix("evaluate.harder.icy."): value for key, value in values.items()}
    assert own["success_rate_mean"] == pytest.approx((2 / 3 + 0) / 2) and own["success_rate_min_pair"] == 0
    assert own["success_rate_mean_10cm"] == pytest.approx((2 / 3 + 1 / 3) / 2)
    assert own["standard_success_rate_mean"] == pytest.approx(1 / 3)
    assert own["standard_success_rate_mean_10cm"] == pytest.approx(2 / 3)
    assert own["lost"] == own["gained"] == pytest.approx(1 / 6)
    assert own["planning_failure_rate"] == pytest.approx(1 / 3)
    assert own["cube--can.success_rate"] == pytest.approx(2 / 3) and own["cube--box.success_rate_10cm"] == 1 / 3
    assert harder_summary([]) == {}


def test_what_a_setting_changes_is_said_with_the_standard_value():
    setting = HarderSetting(source="learned", evaluate={"perturbation": 0.01}, physics={"object_friction": 0.6})
    first, second = changes_of(setting, EvaluateParameters(perturbation=0.004), PhysicsParameters())
    assert (first.name, first.standard, first.here) == ("evaluate.perturbation", "0.004", "0.01")
    assert first.meaning == EvaluateParameters.model_fields["perturbation"].description
    assert (second.name, second.standard, second.here) == ("physics.object_friction", "0.9", "0.6")
    assert setting.source == "learned"


def test_the_section_shows_both_rules_and_every_reason():
    one = made_up.harder("cube", ["can", "box"])
    html = harder_section([one], "20 cm, 2 s", 0.7)
    for rate in (1 / 3, 2 / 3):  # of the can in the standard setting by either rule, and here by both
        assert percent(rate) in html
    assert all(TRIALS[reason] in html for reason in reasons_of(one.pairs))


def test_a_row_without_its_standard_trial_is_refused():
    rows = made_up.trials("cube", ["can"])
    with pytest.raises(pd.errors.MergeError):
        made_up.harder("cube", ["can"], standard=pd.concat([rows, rows]))
