import re
from pathlib import Path

import pytest

from pipeline.report.rates import pair_merge, pair_trials, single_grasp_funnel
from pipeline.report.summary import key_of_check, rounded, summarize
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
        pair_merge("cube", side, made_up.merged("cube", side, accepted))
        for side, accepted in zip(SIDES, (2, 1), strict=True)
    ]
    trials = made_up.trials("cube", SIDES)
    counted = [pair_trials("cube", side, trials) for side in SIDES]
    sources = {"synthesized": counted, "learned": counted}
    reconstructions = {"demo": made_up.RECONSTRUCTION}
    learned, harder = made_up.learned("cube", SIDES), [made_up.harder("cube", SIDES)]
    return summarize("tiny", funnels, merges, sources, reconstructions, learned, harder)


def documented_patterns(repository: Path) -> list[re.Pattern]:
    text = (repository / "docs/metrics.md").read_text()
    keys = re.findall(r"^\| `([^`]+)` \|", text, re.MULTILINE)
    patterns = []
    for key in keys:
        pattern = re.escape(key)
        for place, letters in (
            ("style", "pinch|side"),
            ("source", "[a-z]+"),
            ("object", "[a-z0-9_]+"),
            ("capture", "[a-z0-9_]+"),
            ("setting", "[a-z0-9_]+"),
            ("first", "[a-z0-9_]+"),
            ("second", "[a-z0-9_]+"),
            ("check", "[a-z0-9_.]+"),
            ("reason", "[a-z0-9_.]+"),
        ):
            pattern = pattern.replace(f"<{place}>", f"(?:{letters})")
        patterns.append(re.compile(pattern))
    return patterns


def test_every_key_is_documented_and_every_documented_key_exists(summary, repository):
    patterns = documented_patterns(repository)
    assert [key for key in summary if not any(pattern.fullmatch(key) for pattern in patterns)] == []
    assert [p.pattern for p in patterns if not any(p.fullmatch(key) for key in summary)] == []


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


def test_figures_of_a_harder_setting(summary):
    assert summary["evaluate.harder.icy.trials"] == 6
    assert summary["evaluate.harder.icy.failed.first_slip"] == pytest.approx(1 / 6, abs=1e-6)


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
