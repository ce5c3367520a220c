"""The learned model: its curve, the quality of its samples without physics, and how it did on pairs kept from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from statistics import median
from typing import Any

import pandas as pd

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.reading import read_json
from pipeline.report.charts import CATEGORY_COLOURS, bars_with_table, numbers, percent, spread_table, table
from pipeline.report.comparisons import (
    ABLATION,
    ABLATION_FILE,
    OBJECTIVES,
    OBJECTIVES_FILE,
    Comparison,
    comparison_part,
    read_comparison,
)
from pipeline.report.meanings import MERGE, explained
from pipeline.report.rates import MOST_PAIRS, PairMerge, PairTrials, mean, ratio, spread, summed

PASSED = "passed"
LOSSES = {
    "training_loss": "training",
    "held_out_loss": "grasps kept from training",
    "held_out_pair_loss": "pairs kept from training",
}


@dataclass(frozen=True)
class Learned:
    """What the model's stages left behind."""

    history: Sequence[Mapping[str, float]]  # rows of history.csv
    quality: Mapping[tuple[str, str], Mapping[str, Any]]  # per pair, see `load_quality`
    samples: Sequence[PairMerge]  # fates of the samples that were tried
    objectives: Comparison | None = None  # published ones, of other runs
    ablation: Comparison | None = None


def load_learned(quality: Mapping[tuple[str, str], Mapping[str, Any]], samples: Sequence[PairMerge]) -> Learned:
    """Read what ``train`` and scripts of ``benchmarks/`` say of the model.

    Args:
        quality: see :func:`load_quality`.
        samples: fates of the samples of the same pairs.

    Raises:
        UserError: a file is missing or damaged.
    """
    try:
        history = pd.read_csv(paths.MODEL_FOLDER / "history.csv").to_dict("records")
    except (OSError, ValueError) as error:
        raise UserError(
            f"{paths.MODEL_FOLDER}/history.csv is missing or damaged; run `dvc repro train` to make it again."
        ) from error
    return Learned(
        history=[{str(name): value for name, value in row.items()} for row in history],
        quality=quality,
        samples=samples,
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
        for fates in learned.samples:
            item = f"sample.{fates.first}--{fates.second}"
            values |= {f"{item}.tried": fates.tried, f"{item}.accepted": fates.accepted}
            values[f"{item}.acceptance_rate"] = fates.acceptance_rate
    else:
        tried, accepted = (sum(getattr(one, name) for one in learned.samples) for name in ("tried", "accepted"))
        values |= {"sample.tried": tried, "sample.accepted": accepted, "sample.acceptance_rate": ratio(accepted, tried)}
        values["sample.min_per_pair"] = min(fates.accepted for fates in learned.samples)
    unseen = [pair for pair in trials if not learned.quality[pair.first, pair.second]["trained"]]
    if unseen:
        values["evaluate.learned.held_out_pairs.pairs"] = len(unseen)
        values["evaluate.learned.held_out_pairs.success_rate_mean"] = mean([pair.success_rate for pair in unseen])
    return values


def _quality_table(learned: Learned) -> str:
    rows = []
    for (first, second), own in learned.quality.items():
        cells = [f"{first} + {second}".replace("_", " "), "yes" if own["trained"] else "no", str(own["drawn"])]
        for name in ("penetration_mm_median", "contact_distance_mm_median"):
            cells += [f"{own['raw'][name]:.2f}", f"{own['ranked'][name]:.2f}" if own["ranked"] else "–"]
        held_out = own["held_out"]
        cells += [f"{percent(held_out['covered'])} of {held_out['grasps']}"] if held_out else ["–"]
        by_training = own["held_out_by_training"]
        cells += [percent(by_training["covered"])] if by_training else ["–"]
        cells += [f"{held_out['nearest_mm_median']:.1f}"] if held_out else ["–"]
        rows.append(cells)
    headers = ["pair", "trained together", "drawn", "overlap, raw (mm)", "ranked", "contact distance, raw (mm)"]
    headers += ["ranked", "kept grasps that a sample is near to", "that one of as many training grasps is near to"]
    headers += ["distance to the nearest sample (mm)"]
    return table(headers, rows)


def _quality_spreads(learned: Learned) -> str:
    """Return the same figures as distributions over the pairs."""
    every = list(learned.quality.values())

    def values(part: str, name: str) -> list[float]:
        return [own[part][name] for own in every if own[part]]

    figures = [
        (f"{title}, {state} (mm)", values(part, name), 2)
        for title, name in (
            ("overlap", "penetration_mm_median"),
            ("contact distance", "contact_distance_mm_median"),
        )
        for part, state in (("raw", "raw"), ("ranked", "ranked"))
    ]
    figures += [
        ("kept grasps that a sample is near to (%)", [100 * one for one in values("held_out", "covered")], 1),
        (
            "that one of as many training grasps is near to (%)",
            [100 * one for one in values("held_out_by_training", "covered")],
            1,
        ),
        ("distance to the nearest sample (mm)", values("held_out", "nearest_mm_median"), 1),
    ]
    return spread_table("figure of a pair", [(title, len(own), spread(own), digits) for title, own, digits in figures])


def learned_section(learned: Learned) -> str:
    """Return the curve, the quality of samples per pair, and the fates of those that were tried."""
    if few := len(learned.samples) <= MOST_PAIRS:
        bars = [
            (f"{fates.first} + {fates.second}".replace("_", " "), {PASSED: fates.accepted, **fates.rejected})
            for fates in learned.samples
        ]
    else:
        accepted = sum(fates.accepted for fates in learned.samples)
        bars = [("all pairs", {PASSED: accepted, **summed(fates.rejected for fates in learned.samples)})]
    return (
        "<p>A generative model, conditioned on the point clouds of both objects, is trained on the merged grasps. Its "
        "samples are refined on the grasp energy, ranked by it, and checked like any merged grasp; what passes is "
        "carried out like synthesized grasps.</p>\n"
        f"{loss_curves(learned.history)}{loss_numbers(learned.history)}"
        "<p>Losses: mean squared error of the prediction. Where that of kept grasps rises and that of training falls, "
        "there are too few grasps to learn more from than themselves.</p>\n"
        "<h3>Samples without physics</h3>\n"
        "<p>Medians. Overlap: the deepest point of hand or object inside the other. Contact distance: of the assigned "
        "contacts to the surface. Ranked: refined, and accepted by the checks. A sample is near to a grasp that was "
        "kept from training when points of the hand are less than 15 mm off on average.</p>\n"
        f"{_quality_table(learned) if few else _quality_spreads(learned)}"
        "<h3>Samples that were tried, by the first check that they failed</h3>\n"
        + bars_with_table(bars, PASSED, "Fate of samples per pair", "pair")
        + explained((check for fates in learned.samples for check in fates.rejected), MERGE)
        + published_comparisons(learned)
    )


def published_comparisons(learned: Learned) -> str:
    """Return the two tables that scripts of ``benchmarks/`` made, with how they were made."""
    return (
        "<h3>Published comparisons: not results of this run</h3>\n"
        "<p>Each was made once by the command under its title, on the data named there, and is kept in git. They are "
        "the reasons for the default settings.</p>\n"
        + comparison_part(
            "Objectives and samplers",
            learned.objectives,
            OBJECTIVES,
            "benchmarks/learned_objectives.py",
            "Every training has the same network and number of steps. Samples as drawn, medians over a pair. Usable: "
            "hand and objects overlap at most 1 mm, contacts are at most 2 mm off on average, objects apart.",
        )
        + comparison_part(
            "From samples to grasps, step by step",
            learned.ablation,
            ABLATION,
            "benchmarks/learned_ablation.py",
            "All rows begin with the same draws. Each takes the first grasps that it accepts and tries the first of "
            "them with the robot, one grasp per trial; the same grasp has the same trial in every row. Pass all "
            "checks: those of merging, physics included. Rotations are projected and joints clamped in every row.",
        )
    )


def loss_numbers(history: Sequence[Mapping[str, float]]) -> str:
    """Return the rows of the curves, folded."""
    shown = [name for name in LOSSES if name in history[0]]
    rows = [[f"{row['step']:g}", *(f"{row[name]:.5g}" for name in shown)] for row in history]
    return numbers("Losses: numbers", table(["step", *(LOSSES[name] for name in shown)], rows))


def loss_curves(history: Sequence[Mapping[str, float]]) -> str:
    """Return the losses over the steps of the training as SVG."""
    left, top, width, height = 60, 30, 640, 220
    shown = [name for name in LOSSES if name in history[0]]
    last_step = max(row["step"] for row in history)
    most = max(row[name] for row in history for name in shown)
    parts = [f'<svg class="bars" viewBox="0 0 {left + width + 20} {top + height + 40}" role="img" aria-label="Losses">']
    for share in (0.0, 0.5, 1.0):
        y = top + height * (1 - share)
        parts.append(f'<line x1="{left}" x2="{left + width}" y1="{y:.1f}" y2="{y:.1f}" stroke="#ccc"/>')
        parts.append(f'<text x="{left - 8}" y="{y + 4:.1f}" text-anchor="end">{most * share:.3g}</text>')
    for index, name in enumerate(shown):
        colour = CATEGORY_COLOURS[(4, 0, 2)[index]]
        places = [(left + width * row["step"] / last_step, top + height * (1 - row[name] / most)) for row in history]
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
        parts.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="2"/>')
        parts.append(f'<rect x="{left + 220 * index}" y="4" width="12" height="12" fill="{colour}"/>')
        parts.append(f'<text x="{left + 17 + 220 * index}" y="15">{escape(LOSSES[name])}</text>')
    parts.append(f'<text x="{left}" y="{top + height + 20}">0</text>')
    parts.append(f'<text x="{left + width}" y="{top + height + 20}" text-anchor="end">{last_step:g} steps</text>')
    return "\n".join([*parts, "</svg>\n"])
