import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.report.rates import MOST_PAIRS, pair_merge, pair_trials, single_grasp_funnel
from pipeline.report.summary import MOST_OBJECTS, key_of_check, rounded, summarize
from tests.report import made_up

SIDES = ["can", "box"]


@pytest.fixture(scope="module")
def summary() -> dict:
    funnels = [
        single_grasp_funnel(style, name, made_up.candidates(style, name), made_up.validated(style, name))
        for style, names in (("pinch", ["cube"]), ("side", SIDES))
        for name in names
    ]
    merges = [
        pair_merge("cube", side, made_up.merged("cube", side, accepted)["rejected_by"])
        for side, accepted in zip(SIDES, (2, 1), strict=True)
    ]
    trials = made_up.trials("cube", SIDES)
    counted = [pair_trials("cube", side, trials) for side in SIDES]
    sources = {"synthesized": counted, "learned": counted}
    reconstructions = {"demo": made_up.RECONSTRUCTION}
    learned, tried = made_up.learned("cube", SIDES), [made_up.tried("cube", SIDES)]
    return summarize("tiny", funnels, merges, sources, reconstructions, learned, tried)


OBJECTS = MOST_PAIRS + 1


def pairs_of(count: int, partners: int = 1) -> list:
    """Counts of pairs of so many first objects; those of an odd number have one grasp."""
    return [
        one
        for index in range(count)
        for one in made_up.counts(
            f"first_{index}", [f"second_{index + k}" for k in range(partners)], accepted=index % 2
        )
    ]


def large_summary(objects: int, partners: int = 1) -> dict:
    """The summary of a run of many pairs, both sources alike."""
    counts = pairs_of(objects, partners)
    merges, trials = [one.grasps for one in counts], [one.trials for one in counts]
    funnels = [
        single_grasp_funnel(style, f"object_{index}", made_up.candidates(style, "x"), made_up.validated(style, "x"))
        for style in ("pinch", "side")
        for index in range(objects)
    ]
    learned = replace(
        made_up.learned("first_0", ["second_0"]),
        quality={(one.first, one.second): made_up.quality("x", ["y"])["y"] for one in counts},
        samples=merges,
    )
    return summarize("tiny", funnels, merges, {"synthesized": trials, "learned": trials}, {}, learned)


@pytest.fixture(scope="module")
def large() -> dict:
    return large_summary(OBJECTS)


@pytest.fixture(scope="module")
def dense() -> dict:
    """Few objects, many pairs."""
    return large_summary(MOST_OBJECTS // 2, partners=5)


def documented_patterns(repository: Path) -> list[re.Pattern]:
    keys = re.findall(r"^\| `([^`]+)` \|", (repository / "docs/metrics.md").read_text(), re.MULTILINE)
    letters = {"<style>": "(?:pinch|side)", "<check>": "[a-z0-9_.]+", "<reason>": "[a-z0-9_.]+"}
    parts = [re.split(r"(<\w+>)", key) for key in keys]
    return [
        re.compile("".join(letters.get(part, "[a-z0-9_]+") if part[:1] == "<" else re.escape(part) for part in own))
        for own in parts
    ]


def test_every_key_is_documented_and_every_documented_key_exists(summary, large, dense, repository):
    patterns, keys = documented_patterns(repository), {*summary, *large, *dense}
    assert [key for key in keys if not any(pattern.fullmatch(key) for pattern in patterns)] == []
    assert [p.pattern for p in patterns if not any(p.fullmatch(key) for key in keys)] == []


def test_the_summary_does_not_grow_with_the_run(large):
    assert len(large_summary(3 * OBJECTS)) == len(large) < 150
    assert not [key for key in large if "first_" in key or "object_" in key]


def test_many_pairs_are_told_by_quartiles(large):
    accepted = [index % 2 for index in range(OBJECTS)]
    quartiles = [large[f"merge.per_pair_{name}"] for name in ("quartile_1", "median", "quartile_3")]
    assert quartiles == np.percentile(accepted, [25, 50, 75]).tolist()
    assert large["merge.mean_per_pair"] == pytest.approx(np.mean(accepted), abs=1e-6)
    assert large["merge.pairs"] == large["evaluate.synthesized.pairs"] == OBJECTS
    assert large["evaluate.synthesized.success_rate_median"] == pytest.approx(1 / 3, abs=1e-6)
    assert large["evaluate.synthesized.failed.plan_second"] == pytest.approx(1 / 3, abs=1e-6)
    assert large["merge.rejected.hand_clearance"] == pytest.approx(OBJECTS / (OBJECTS + sum(accepted)), abs=1e-6)
    assert large["sample.accepted"] == sum(accepted)


def test_objects_of_many_pairs_keep_their_own_keys_while_they_are_few(dense):
    assert dense["evaluate.learned.first.first_0.success_rate_mean"] == pytest.approx(1 / 3, abs=1e-6)
    assert dense["validate.pinch.object_0.survival_rate"] == 0.5
    assert not [key for key in dense if "--" in key]


def test_as_many_pairs_as_the_paper_has_keep_their_keys():
    trials = [one.trials for one in pairs_of(MOST_PAIRS)]
    values = summarize("paper", [], [], {"synthesized": trials}, {})
    assert values["evaluate.synthesized.first_0--second_0.trials"] == 3 and "evaluate.synthesized.pairs" not in values


def test_headline_figures(summary):
    assert summary["scale"] == "tiny"
    rates = [summary[f"merge.cube--{side}.acceptance_rate"] for side in SIDES]
    assert summary["merge.acceptance_rate_mean"] == pytest.approx(sum(rates) / 2, abs=1e-6)
    assert summary["merge.acceptance_rate_min_pair"] == min(rates)
    assert summary["merge.grasps"] == 3 and summary["merge.min_per_pair"] == 1
    assert summary["merge.acceptance_rate"] == 0.6  # each pair has one rejected combination
    assert summary["validate.survival_rate_mean"] == 0.5  # 2 of 4 chains of every object
    assert summary["evaluate.synthesized.trials"] == 6
    assert summary["evaluate.synthesized.success_rate_mean"] == pytest.approx(1 / 3, abs=1e-6)
    assert summary["evaluate.synthesized.success_rate_mean_10cm"] == pytest.approx(2 / 3, abs=1e-6)
    assert summary["evaluate.synthesized.planning_failure_rate"] == pytest.approx(1 / 3, abs=1e-6)


def test_figures_of_a_condition(summary):
    assert summary["evaluate.conditions.icy.sapien.synthesized.trials"] == 6
    assert summary["evaluate.conditions.icy.sapien.synthesized.failed.first_slip"] == pytest.approx(1 / 6, abs=1e-6)


def test_figures_of_the_model(summary):
    assert summary["train.steps"] == 2 and summary["train.training_loss"] == 0.5
    assert summary["train.validation_loss"] == 1.0 and summary["train.validation_loss_held_out_pairs"] == 1.5
    assert summary["train.penetration_mm_median"] == 0.5 and summary["train.penetration_mm_median_raw"] == 1.0
    assert summary["train.held_out_covered"] == 0.5 and summary["train.held_out_covered_by_training"] == 0.75
    assert summary["sample.cube--can.acceptance_rate"] == pytest.approx(2 / 3, abs=1e-6)
    assert summary["evaluate.learned.held_out_pairs.pairs"] == 1
    assert summary["evaluate.learned.held_out_pairs.success_rate_mean"] == pytest.approx(1 / 3, abs=1e-6)


def test_only_the_scale_is_a_text_and_keys_are_sorted(summary):
    assert [key for key, value in summary.items() if isinstance(value, str)] == ["scale"]
    assert list(summary) == sorted(summary)


def test_keys_have_only_letters_that_mlflow_takes(summary):
    assert all(re.fullmatch(r"[A-Za-z0-9_.\-/ ]+", key) for key in summary)
    assert key_of_check("gravity:-x") == "gravity.minus_x" and key_of_check("gravity:+x") == "gravity.plus_x"


def test_a_pair_without_trials_counts_as_no_success():
    pairs = [pair_trials("cube", side, made_up.trials("cube", ["can"])) for side in SIDES]
    values = summarize("tiny", [], [], {"synthesized": pairs}, {})
    assert values["evaluate.synthesized.success_rate_min_pair"] == 0.0
    assert values["evaluate.synthesized.success_rate_mean"] == pytest.approx(1 / 6, abs=1e-6)


@pytest.mark.parametrize(("value", "expected"), [(1 / 3, 0.333333), (123456.789, 123457.0), (7, 7), ("a", "a")])
def test_six_significant_digits(value, expected):
    assert rounded(value) == expected
