"""The learned model: its curve, the quality of its samples without physics, and its success on held-out pairs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

import pandas as pd
from markupsafe import Markup

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.reading import read_json
from pipeline.report.charts import Curves, Table, curves, explanations, spread_table, stacked_bars
from pipeline.report.comparisons import (
    ABLATION,
    ABLATION_FILE,
    OBJECTIVES,
    OBJECTIVES_FILE,
    Comparison,
    comparison_table,
    read_comparison,
)
from pipeline.report.meanings import MERGE
from pipeline.report.rates import MOST_PAIRS, PairMerge, PairTrials, mean, ratio, spread, summed
from pipeline.report.rendering import render
from pipeline.report.wording import PASSED, UNKNOWN, pair_title, percent

LOSSES = {
    "training_loss": "training",
    "held_out_loss": "held-out grasps",
    "held_out_pair_loss": "held-out pairs",
}


@dataclass(frozen=True)
class Learned:
    """What the model's stages left behind."""

    history: Sequence[Mapping[str, float]]  # rows of history.csv
    quality: Mapping[tuple[str, str], Mapping[str, Any]]  # per pair, see `load_quality`
    samples: Sequence[PairMerge]  # outcomes of the samples that were tried
    view: str = "whole"  # what the model saw of objects, as train.data.view
    objectives: Comparison | None = None  # published ones, of other runs
    ablation: Comparison | None = None


def load_learned(quality: Mapping[tuple[str, str], Mapping[str, Any]], samples: Sequence[PairMerge]) -> Learned:
    """Read the training history and the comparisons that scripts of ``benchmarks/`` published.

    Args:
        quality: see :func:`load_quality`.
        samples: outcomes of the samples of the same pairs.

    Raises:
        UserError: a file is missing or damaged.
    """
    try:
        history = pd.read_csv(paths.MODEL_FOLDER / "history.csv").to_dict("records")
    except (OSError, ValueError) as error:
        raise UserError(
            f"{paths.MODEL_FOLDER}/history.csv is missing or damaged; run `dvc repro train` to make it again."
        ) from error
    config = read_json(paths.MODEL_FOLDER / "model.json", "run `dvc repro train` to make it again")
    return Learned(
        history=[{str(name): value for name, value in row.items()} for row in history],
        quality=quality,
        samples=samples,
        view=config.get("view", "whole"),
        objectives=read_comparison(OBJECTIVES_FILE, OBJECTIVES),
        ablation=read_comparison(ABLATION_FILE, ABLATION),
    )


def load_quality(source: str, partners: Mapping[str, Sequence[str]]) -> dict[tuple[str, str], Mapping[str, Any]]:
    """Read the figures on what the model drew for every pair of one source.

    Raises:
        UserError: the file is missing or damaged, or lacks a pair.
    """
    file = paths.sample_quality_file(source)
    mend = f"run `dvc repro sample@{source}` to make it again"
    content = read_json(file, mend)
    try:
        return {(first, second): content[first][second] for first, own in partners.items() for second in own}
    except (KeyError, TypeError) as error:
        raise UserError(f"{file} lacks a pair of params.yaml ({error}); delete it and {mend}.") from error


def learned_summary(learned: Learned, trials: Sequence[PairTrials]) -> dict[str, float | int]:
    """Return the model's part of the summary.

    Args:
        trials: with the grasps of the model.
    """
    last = learned.history[-1]
    values: dict[str, float | int] = {"train.steps": int(last["step"]), "train.training_loss": last["training_loss"]}
    values["train.single_view"] = int(learned.view == "single")
    if "held_out_loss" in last:
        values["train.validation_loss"] = last["held_out_loss"]
    if "held_out_pair_loss" in last:
        values["train.validation_loss_held_out_pairs"] = last["held_out_pair_loss"]
    for name in ("penetration_mm_median", "contact_distance_mm_median"):
        ranked = [own["ranked"][name] for own in learned.quality.values() if own["ranked"]]
        values[f"train.{name}"] = median(ranked) if ranked else 0.0
        values[f"train.{name}_raw"] = median(own["raw"][name] for own in learned.quality.values())
    values["train.joint_violation_mean"] = mean([own["joint_violation_mean"] for own in learned.quality.values()])
    covered = [own["held_out"] for own in learned.quality.values() if own["held_out"]]
    if covered:
        values["train.held_out_covered"] = mean([own["covered"] for own in covered])
        values["train.held_out_nearest_mm_median"] = median(own["nearest_mm_median"] for own in covered)
    by_training = [own["held_out_by_training"] for own in learned.quality.values() if own["held_out_by_training"]]
    if by_training:
        values["train.held_out_covered_by_training"] = mean([own["covered"] for own in by_training])
    if len(learned.samples) <= MOST_PAIRS:
        for one in learned.samples:
            item = f"sample.{one.first}--{one.second}"
            values |= {f"{item}.tried": one.tried, f"{item}.accepted": one.accepted}
            values[f"{item}.acceptance_rate"] = one.acceptance_rate
    else:
        tried, accepted = (sum(getattr(one, name) for one in learned.samples) for name in ("tried", "accepted"))
        values |= {"sample.tried": tried, "sample.accepted": accepted, "sample.acceptance_rate": ratio(accepted, tried)}
        values["sample.min_per_pair"] = min(one.accepted for one in learned.samples)
    unseen = [pair for pair in trials if not learned.quality[pair.first, pair.second]["trained"]]
    if unseen:
        values["evaluate.learned.held_out_pairs.pairs"] = len(unseen)
        values["evaluate.learned.held_out_pairs.success_rate_mean"] = mean([pair.success_rate for pair in unseen])
    return values


def learned_section(learned: Learned) -> Markup:
    """Return the curve, the quality of samples, the outcomes of those that were tried, and published comparisons."""
    few = len(learned.samples) <= MOST_PAIRS
    rejected = summed(one.rejected for one in learned.samples)
    if few:
        bars = [(pair_title(one.first, one.second), {PASSED: one.accepted, **one.rejected}) for one in learned.samples]
    else:
        bars = [("all pairs", {PASSED: sum(one.accepted for one in learned.samples), **rejected})]
    return render(
        "learned.html",
        view=learned.view,
        losses=loss_curves(learned.history),
        quality=_quality_table(learned) if few else _quality_spreads(learned),
        outcomes=stacked_bars(bars, PASSED, "Outcomes of samples per pair", "pair"),
        reasons=explanations(rejected, MERGE),
        objectives=learned.objectives,
        objectives_table=comparison_table(learned.objectives, OBJECTIVES),
        ablation=learned.ablation,
        ablation_table=comparison_table(learned.ablation, ABLATION),
    )


def loss_curves(history: Sequence[Mapping[str, float]]) -> Curves:
    """Return the losses over the steps of the training."""
    lines = {title: [row[name] for row in history] for name, title in LOSSES.items() if name in history[0]}
    return curves([row["step"] for row in history], lines, "Losses", "steps")


def _quality_table(learned: Learned) -> Table:
    rows = []
    for (first, second), own in learned.quality.items():
        cells = [pair_title(first, second), "yes" if own["trained"] else "no", str(own["drawn"])]
        for name in ("penetration_mm_median", "contact_distance_mm_median"):
            cells += [f"{own['raw'][name]:.2f}", f"{own['ranked'][name]:.2f}" if own["ranked"] else UNKNOWN]
        held_out, by_training = own["held_out"], own["held_out_by_training"]
        cells += [f"{percent(held_out['covered'])} of {held_out['grasps']}" if held_out else UNKNOWN]
        cells += [percent(by_training["covered"]) if by_training else UNKNOWN]
        cells += [f"{held_out['nearest_mm_median']:.1f}" if held_out else UNKNOWN]
        rows.append(cells)
    headers = ["pair", "trained together", "drawn", "overlap, raw (mm)", "ranked", "contact distance, raw (mm)"]
    headers += ["ranked", "held-out grasps near a sample", "near one of as many training grasps"]
    headers += ["distance to the nearest sample (mm)"]
    return Table(headers, rows)


def _quality_spreads(learned: Learned) -> Table:
    """Return the same figures as distributions over the pairs."""
    every = list(learned.quality.values())

    def values(part: str, name: str, factor: float = 1.0) -> list[float]:
        return [factor * own[part][name] for own in every if own[part]]

    figures = [
        ("overlap, raw (mm)", values("raw", "penetration_mm_median"), 2),
        ("overlap, ranked (mm)", values("ranked", "penetration_mm_median"), 2),
        ("contact distance, raw (mm)", values("raw", "contact_distance_mm_median"), 2),
        ("contact distance, ranked (mm)", values("ranked", "contact_distance_mm_median"), 2),
        ("held-out grasps near a sample (%)", values("held_out", "covered", 100), 1),
        ("near one of as many training grasps (%)", values("held_out_by_training", "covered", 100), 1),
        ("distance to the nearest sample (mm)", values("held_out", "nearest_mm_median"), 1),
    ]
    return spread_table("figure of a pair", [(title, len(own), spread(own), digits) for title, own, digits in figures])
