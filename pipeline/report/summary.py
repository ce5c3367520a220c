"""The flat summary: every headline figure under a dotted key; ``docs/metrics.md`` says what each means."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pipeline.report.harder import Harder, harder_summary, reasons_of
from pipeline.report.learned import Learned, learned_summary
from pipeline.report.rates import Funnel, PairMerge, PairTrials, mean, ratio
from pipeline.report.reconstructed import reconstructed_summary

Value = float | int | str


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
    harder: Sequence[Harder] = (),
) -> dict[str, Value]:
    """Return the summary, sorted by key.

    Args:
        trials: per source of grasps, one entry per pair.
        reconstructions: per capture what its ``metrics.json`` holds.
        learned: of the model.
        harder: one entry per harder setting.
    """
    values: dict[str, Value] = {"scale": scale}
    for funnel in funnels:
        values |= _of_object(funnel)
    values["synthesize.pass_rate_mean"] = mean([funnel.pass_rate for funnel in funnels])
    values["validate.survival_rate_mean"] = mean([funnel.survival_rate for funnel in funnels])
    values["validate.validated"] = sum(funnel.validated for funnel in funnels)
    for merge in merges:
        values |= _of_merge(merge)
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
    values |= harder_summary(harder)
    for one in harder:
        values |= _shares(f"evaluate.harder.{one.name}.failed", reasons_of(one.pairs), one.trials)
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
