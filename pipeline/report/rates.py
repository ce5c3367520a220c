"""Counts and rates of every stage, taken from the tables' rows and from nothing else."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np

# Up to so many pairs, page, summary and data card have a row for each; past it they give distributions (`Spread`) over
# all pairs, and reports/pairs.parquet has a row for each.
MOST_PAIRS = 64
OUTCOMES = ("object0", "object1", "merged_id", "success", "success_10cm", "reason", "planning_attempts")  # of trials
PLANNING_FAILURE = "plan "  # how reasons of trials begin that ended because no motion was found

Columns = Mapping[str, Any]  # of a table, each a sequence; a data frame is one, too


@dataclass(frozen=True)
class Funnel:
    """What became of the chains of one object in one style."""

    style: str
    object_name: str
    optimised: int  # chains run
    passed: int  # chains that passed the filter of the synthesis
    validated: int  # of those, grasps that passed every check of physics
    contact_only_tested: int  # grasps on which the paper's rule was decided
    contact_only_passed: int
    synthesize_rejected: dict[str, int]  # first failed check -> chains
    validate_rejected: dict[str, int]  # first failed check -> grasps that had passed the filter

    @property
    def pass_rate(self) -> float:
        """Chains that passed the filter / chains."""
        return ratio(self.passed, self.optimised)

    @property
    def survival_rate(self) -> float:
        """Validated grasps / chains."""
        return ratio(self.validated, self.optimised)

    @property
    def survival_rate_of_passed(self) -> float:
        """Validated grasps / chains that passed the filter."""
        return ratio(self.validated, self.passed)


@dataclass(frozen=True)
class PairMerge:
    """What became of the combinations tried for one pair."""

    first: str
    second: str
    tried: int
    accepted: int
    rejected: dict[str, int]

    @property
    def acceptance_rate(self) -> float:
        """Accepted / tried."""
        return ratio(self.accepted, self.tried)


@dataclass(frozen=True)
class PairTrials:
    """How the robot fared with one pair."""

    first: str
    second: str
    trials: int
    successes: int
    successes_10cm: int
    planning_failures: int
    attempts: int  # two-object grasps for which moves were planned
    planned: int  # of these, grasps with moves for both picks
    reasons: dict[str, int]  # of failed trials

    @property
    def success_rate(self) -> float:
        """Successes / trials; 0 for a pair without trials."""
        return ratio(self.successes, self.trials)

    @property
    def success_rate_10cm(self) -> float:
        """The same by the released code's rule."""
        return ratio(self.successes_10cm, self.trials)

    @property
    def planning_failure_rate(self) -> float:
        """Trials that ended because no motion was found / trials."""
        return ratio(self.planning_failures, self.trials)

    @property
    def reachable_rate(self) -> float:
        """Grasps with moves for both picks / grasps for which moves were planned before anything had moved."""
        return ratio(self.planned, self.attempts)


@dataclass(frozen=True)
class Spread:
    """How some values are distributed; all 0 where there are none."""

    mean: float
    least: float
    quartile_1: float
    median: float
    quartile_3: float
    most: float


def spread(values: Sequence[float]) -> Spread:
    """Return mean, extremes and quartiles (interpolated linearly) of ``values``."""
    if not len(values):
        return Spread(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    least, first, median, third, most = np.percentile(np.asarray(values, np.float64), [0, 25, 50, 75, 100]).tolist()
    return Spread(mean(list(values)), least, first, median, third, most)


def summed(counts: Iterable[Mapping[str, int]]) -> dict[str, int]:
    """Return the sums of counts by name, sorted by name."""
    total: dict[str, int] = {}
    for count in counts:
        for name, number in count.items():
            total[name] = total.get(name, 0) + number
    return dict(sorted(total.items()))


def ratio(part: int, whole: int) -> float:
    """Return part / whole, and 0 where there is nothing."""
    return part / whole if whole else 0.0


def mean(values: list[float]) -> float:
    """Return the arithmetic mean, and 0 of nothing."""
    return sum(values) / len(values) if values else 0.0


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """Return the 95 % score interval of a proportion (Wilson, 1927); (0, 1) without trials."""
    if trials == 0:
        return 0.0, 1.0
    z = 1.959963984540054
    p, z2 = successes / trials, z * z
    centre = (p + z2 / (2 * trials)) / (1 + z2 / trials)
    half = z / (1 + z2 / trials) * sqrt(p * (1 - p) / trials + z2 / (4 * trials * trials))
    return max(0.0, centre - half), min(1.0, centre + half)


def count_rejections(rejected_by: Iterable[str]) -> dict[str, int]:
    """Return how many rows failed first at each check, sorted by name; passed rows ('') are left out."""
    return dict(sorted(Counter(check for check in rejected_by if check != "").items()))


def single_grasp_funnel(style: str, object_name: str, candidates: Columns, validated: Columns) -> Funnel:
    """Follow the chains of one object from the filter of the synthesis to the last check of physics."""
    chains = list(candidates["rejected_by"])
    passed = {grasp for grasp, check in zip(candidates["grasp_id"], chains, strict=True) if check == ""}
    rows = zip(validated["grasp_id"], validated["rejected_by"], validated["contact_only_pass"], strict=True)
    tested = [(check, contact) for grasp, check, contact in rows if grasp in passed]
    decided = [bool(contact) for _, contact in tested if contact is not None and contact == contact]
    outcomes = [check for check, _ in tested]
    return Funnel(
        style=style,
        object_name=object_name,
        optimised=len(chains),
        passed=len(passed),
        validated=outcomes.count(""),
        contact_only_tested=len(decided),
        contact_only_passed=sum(decided),
        synthesize_rejected=count_rejections(chains),
        validate_rejected=count_rejections(outcomes),
    )


def pair_merge(first: str, second: str, rejected_by: Iterable[str]) -> PairMerge:
    """Count one pair's combinations, by the first check that each failed."""
    outcomes = list(rejected_by)
    accepted, rejected = outcomes.count(""), count_rejections(outcomes)
    return PairMerge(first, second, tried=len(outcomes), accepted=accepted, rejected=rejected)


def pair_trials(first: str, second: str, trials: Columns) -> PairTrials:
    """Count the outcomes of one pair; ``trials`` may hold other pairs too."""
    own = [
        row for row in zip(*(trials[name] for name in OUTCOMES), strict=True) if row[0] == first and row[1] == second
    ]
    reasons = count_rejections(reason for _, _, _, success, _, reason, _ in own if not success)
    return PairTrials(
        first=first,
        second=second,
        trials=len(own),
        successes=sum(bool(success) for _, _, _, success, _, _, _ in own),
        successes_10cm=sum(bool(success) for _, _, _, _, success, _, _ in own),
        planning_failures=sum(n for reason, n in reasons.items() if reason.startswith(PLANNING_FAILURE)),
        attempts=sum(int(attempts) for *_, attempts in own),
        planned=sum(merged_id >= 0 for _, _, merged_id, *_ in own),
        reasons=reasons,
    )
