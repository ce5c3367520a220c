import pandas as pd
import pytest

from pipeline.report.rates import mean, pair_merge, pair_trials, ratio, single_grasp_funnel, wilson_interval


def test_funnel_follows_only_chains_that_passed_the_filter():
    candidates = pd.DataFrame({"grasp_id": [0, 1, 2, 3], "rejected_by": ["", "distance", "", ""]})
    validated = pd.DataFrame(
        {
            "grasp_id": [0, 1, 2, 3],
            "rejected_by": ["", "distance", "gravity", "table_drift"],
            "contact_only_pass": [True, None, False, True],
        }
    )
    funnel = single_grasp_funnel("pinch", "cube", candidates, validated)
    assert (funnel.optimised, funnel.passed, funnel.validated) == (4, 3, 1)
    assert funnel.synthesize_rejected == {"distance": 1}
    assert funnel.validate_rejected == {"gravity": 1, "table_drift": 1}
    assert (funnel.contact_only_passed, funnel.contact_only_tested) == (2, 3)
    assert funnel.survival_rate == 0.25
    assert funnel.survival_rate_of_passed == pytest.approx(1 / 3)


def test_merge_counts_every_combination_once():
    merged = pd.DataFrame({"rejected_by": ["", "links", "", "sweep", "links"]})
    merge = pair_merge("cube", "can", merged["rejected_by"])
    assert merge.accepted + sum(merge.rejected.values()) == merge.tried == 5
    assert merge.rejected == {"links": 2, "sweep": 1}


def test_trials_of_other_pairs_are_left_out():
    trials = pd.DataFrame(
        {
            "object0": ["cube"] * 5,
            "object1": ["can", "can", "can", "can", "box"],
            "success": [True, False, False, False, True],
            "success_10cm": [True, True, False, False, True],
            "reason": ["", "dropped in hold", "plan second", "plan second", ""],
            "merged_id": [7, 2, -1, 3, 0],  # the fourth trial found no second plan after the first pick
            "planning_attempts": [1, 3, 4, 1, 1],
        }
    )
    pair = pair_trials("cube", "can", trials)
    assert (pair.trials, pair.successes, pair.successes_10cm, pair.planning_failures) == (4, 1, 2, 2)
    assert pair.reasons == {"dropped in hold": 1, "plan second": 2}
    assert (pair.attempts, pair.planned) == (9, 3)
    assert pair.reachable_rate == pytest.approx(1 / 3)


def test_nothing_gives_rate_zero():
    columns = ["object0", "object1", "success", "success_10cm", "reason", "merged_id", "planning_attempts"]
    empty = pd.DataFrame({name: [] for name in columns})
    assert pair_trials("cube", "can", empty).success_rate == 0.0
    assert ratio(0, 0) == 0.0 and mean([]) == 0.0


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilson_interval_agrees_with_newcombe_1998(successes, trials, low, high):
    """Table I, method 3 of Newcombe, Statistics in Medicine 17 (1998)."""
    assert wilson_interval(successes, trials) == pytest.approx((low, high), abs=5e-5)
