"""The flat summary: every headline figure under a dotted key; ``docs/metrics.md`` defines each.

Its length does not grow with the run: past ``MOST_PAIRS`` pairs and ``MOST_OBJECTS`` objects they have no keys of their
own, and keys on their distribution take the place of these.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from pipeline.report.conditions import Tried, conditions_summary, reasons_of, series_prefix
from pipeline.report.learned import Learned, learned_summary
from pipeline.report.rates import MOST_PAIRS, Funnel, PairMerge, PairTrials, mean, ratio, spread, summed
from pipeline.report.reconstructed import reconstructed_summary

Value = float | int | str
MOST_OBJECTS = 32  # counted once per style: each has about 25 keys, and the record holds them twice


def rounded(value: Value) -> Value:
    """Round a float to six significant digits; leave counts and texts alone."""
    return float(f"{value:.6g}") if isinstance(value, float) else value


def summarize(
    scale: str,
    funnels: Sequence[Funnel],
    merges: Sequence[PairMerge],
    trials: dict[str, list[PairTrials]],
    reconstructions: Mapping[str, Mapping[str, Any]],
    learned: Learned | None = None,
    tried: Sequence[Tried] = (),
) -> dict[str, Value]:
    """Return the summary, sorted by key.

    Args:
        trials: per source of grasps, one entry per pair.
        reconstructions: per capture what its ``metrics.json`` holds.
        learned: of the model.
        tried: under other conditions, one entry per series.
    """
    values: dict[str, Value] = {"scale": scale}
    for style in dict.fromkeys(funnel.style for funnel in funnels):
        own = [funnel for funnel in funnels if funnel.style == style]
        values |= _of_style(style, own) if len(funnels) > MOST_OBJECTS else _merged(map(_of_object, own))
    values["synthesize.pass_rate_mean"] = mean([funnel.pass_rate for funnel in funnels])
    values["validate.survival_rate_mean"] = mean([funnel.survival_rate for funnel in funnels])
    values["validate.validated"] = sum(funnel.validated for funnel in funnels)
    values |= _of_all_merges(merges) if len(merges) > MOST_PAIRS else _merged(map(_of_merge, merges))
    accepted = sum(merge.accepted for merge in merges)
    values["merge.grasps"] = accepted
    values["merge.acceptance_rate"] = ratio(accepted, sum(merge.tried for merge in merges))
    values["merge.min_per_pair"] = min((merge.accepted for merge in merges), default=0)
    values["merge.acceptance_rate_mean"] = mean([merge.acceptance_rate for merge in merges])
    values["merge.acceptance_rate_min_pair"] = min((merge.acceptance_rate for merge in merges), default=0.0)
    for source, pairs in trials.items():
        values |= _of_source(source, pairs)
    for capture, metrics in reconstructions.items():
        values |= reconstructed_summary(capture, metrics)
    if learned:
        values |= learned_summary(learned, trials["learned"])
    values |= conditions_summary(tried)
    for one in tried:
        values |= _shares(f"{series_prefix(one.series)}.failed", reasons_of(one.pairs), one.trials)
    return {key: rounded(values[key]) for key in sorted(values)}


def key_of_check(check: str) -> str:
    """Return the name of a check or reason as part of a key, in letters that MLflow takes too.

    ``first slip`` gives ``first_slip``, ``gravity:-x`` gives ``gravity.minus_x``.
    """
    return check.replace(" ", "_").replace(":", ".").replace("+", "plus_").replace("-", "minus_")


def _shares(prefix: str, counts: dict[str, int], whole: int) -> dict[str, Value]:
    return {f"{prefix}.{key_of_check(check)}": ratio(count, whole) for check, count in counts.items()}


def _of_object(funnel: Funnel) -> dict[str, Value]:
    item = f"{funnel.style}.{funnel.object_name}"
    values: dict[str, Value] = {
        f"synthesize.{item}.chains": funnel.optimised,
        f"synthesize.{item}.passed": funnel.passed,
        f"synthesize.{item}.pass_rate": funnel.pass_rate,
        f"validate.{item}.optimised": funnel.optimised,
        f"validate.{item}.validated": funnel.validated,
        f"validate.{item}.survival_rate": funnel.survival_rate,
        f"validate.{item}.survival_rate_of_passed": funnel.survival_rate_of_passed,
    }
    if funnel.contact_only_tested:
        values[f"validate.{item}.contact_only_rate"] = ratio(funnel.contact_only_passed, funnel.contact_only_tested)
    values |= _shares(f"synthesize.{item}.rejected", funnel.synthesize_rejected, funnel.optimised)
    values |= _shares(f"validate.{item}.rejected", funnel.validate_rejected, funnel.passed)
    return values


def _of_merge(merge: PairMerge) -> dict[str, Value]:
    item = f"merge.{merge.first}--{merge.second}"
    values: dict[str, Value] = {
        f"{item}.tried": merge.tried,
        f"{item}.accepted": merge.accepted,
        f"{item}.acceptance_rate": merge.acceptance_rate,
    }
    return values | _shares(f"{item}.rejected", merge.rejected, merge.tried)


def _of_source(source: str, pairs: Sequence[PairTrials]) -> dict[str, Value]:
    trials = sum(pair.trials for pair in pairs)
    values: dict[str, Value] = {
        f"evaluate.{source}.trials": trials,
        f"evaluate.{source}.success_rate_mean": mean([pair.success_rate for pair in pairs]),
        f"evaluate.{source}.success_rate_min_pair": min((pair.success_rate for pair in pairs), default=0.0),
        f"evaluate.{source}.success_rate_mean_10cm": mean([pair.success_rate_10cm for pair in pairs]),
        f"evaluate.{source}.planning_failure_rate": ratio(sum(pair.planning_failures for pair in pairs), trials),
        f"evaluate.{source}.reachable_rate": ratio(
            sum(pair.planned for pair in pairs), sum(pair.attempts for pair in pairs)
        ),
    }
    if len(pairs) > MOST_PAIRS:
        return values | _of_many_pairs(source, pairs)
    for pair in pairs:
        item = f"evaluate.{source}.{pair.first}--{pair.second}"
        values |= {
            f"{item}.trials": pair.trials,
            f"{item}.success_rate": pair.success_rate,
            f"{item}.success_rate_10cm": pair.success_rate_10cm,
            f"{item}.planning_failure_rate": pair.planning_failure_rate,
            f"{item}.reachable_rate": pair.reachable_rate,
        }
        values |= _shares(f"{item}.failed", pair.reasons, pair.trials)
    return values


def _of_many_pairs(source: str, pairs: Sequence[PairTrials]) -> dict[str, Value]:
    prefix = f"evaluate.{source}"
    trials = sum(pair.trials for pair in pairs)
    values: dict[str, Value] = {f"{prefix}.pairs": len(pairs)}
    values |= _quartiles(f"{prefix}.success_rate", [pair.success_rate for pair in pairs])
    values |= _shares(f"{prefix}.failed", summed(pair.reasons for pair in pairs), trials)
    for place in ("first", "second"):
        rates: dict[str, list[float]] = {}
        for pair in pairs:
            rates.setdefault(getattr(pair, place), []).append(pair.success_rate)
        if len(rates) <= MOST_OBJECTS:
            values |= {f"{prefix}.{place}.{name}.success_rate_mean": mean(own) for name, own in rates.items()}
    return values


def _of_all_merges(merges: Sequence[PairMerge]) -> dict[str, Value]:
    accepted = [merge.accepted for merge in merges]
    values: dict[str, Value] = {"merge.pairs": len(merges), "merge.mean_per_pair": mean([float(n) for n in accepted])}
    values |= _quartiles("merge.per_pair", accepted)
    values |= _quartiles("merge.acceptance_rate", [merge.acceptance_rate for merge in merges])
    tried = sum(merge.tried for merge in merges)
    return values | _shares("merge.rejected", summed(merge.rejected for merge in merges), tried)


def _of_style(style: str, funnels: Sequence[Funnel]) -> dict[str, Value]:
    chains, passed = (sum(getattr(funnel, name) for funnel in funnels) for name in ("optimised", "passed"))
    rates = [funnel.survival_rate for funnel in funnels]
    values: dict[str, Value] = {
        f"synthesize.{style}.objects": len(funnels),
        f"synthesize.{style}.chains": chains,
        f"synthesize.{style}.passed": passed,
        f"validate.{style}.validated": sum(funnel.validated for funnel in funnels),
        f"validate.{style}.min_per_object": min(funnel.validated for funnel in funnels),
        f"validate.{style}.survival_rate_mean": mean(rates),
    }
    values |= _quartiles(f"validate.{style}.survival_rate", rates)
    values |= _shares(f"synthesize.{style}.rejected", summed(one.synthesize_rejected for one in funnels), chains)
    return values | _shares(f"validate.{style}.rejected", summed(one.validate_rejected for one in funnels), passed)


def _quartiles(prefix: str, values: Sequence[float]) -> dict[str, Value]:
    own = spread(values)
    return {f"{prefix}_{name}": getattr(own, name) for name in ("quartile_1", "median", "quartile_3")}


def _merged(parts: Iterable[dict[str, Value]]) -> dict[str, Value]:
    return {key: value for part in parts for key, value in part.items()}
