"""benchmarks/history.csv is what git tells of the published runs."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pandas as pd
import pytest

from pipeline.records.errors import UserError
from tools.history import COLUMNS, HISTORY_FILE, published_runs, row_of
from tools.website import over_time

ROOT = Path(__file__).resolve().parents[2]


def test_costs_are_shared_out_by_unit():
    """Stages named by style and source, as they are, or by object as well, as they were."""
    summary = {
        "scale": "demo",
        "validate.validated": 50,
        "validate.survival_rate_mean": 0.5,
        "evaluate.synthesized.trials": 10,
        "evaluate.learned.trials": 30,
    }
    now = {"synthesize@pinch": 4.0, "validate@side": 6.0, "evaluate@learned": 100.0, "evaluate-conditions": 999.0}
    before = {"synthesize-pinch@cube": 4.0, "validate-side@can": 6.0, "evaluate-learned@cube": 100.0, "merge@cube": 9.0}
    for stages in (now, before):
        row = row_of(summary, {name: {"cpu_seconds": seconds} for name, seconds in stages.items()})
        assert row["cpu_seconds_per_validated_grasp"] == 0.2 and row["cpu_seconds_per_trial"] == 2.5
    assert row["survival_rate"] == 0.5 and row["success_rate_learned"] is None
    assert row_of({"scale": "demo"}, {})["cpu_seconds_per_trial"] is None


def test_the_file_is_what_git_tells(monkeypatch):
    monkeypatch.chdir(ROOT)
    kept = pd.read_csv(HISTORY_FILE)
    assert list(kept.columns) == list(COLUMNS)
    try:
        told = {(row["commit"], row["folder"]): row for row in published_runs()}
    except UserError as error:
        pytest.skip(f"no history here: {error}")
    known = [row for row in kept.to_dict("records") if (row["commit"], row["folder"]) in told]
    if not known:
        pytest.skip("a clone without the commits of published runs")
    for row in known:
        for name in COLUMNS:
            value = told[row["commit"], row["folder"]][name]
            assert pd.isna(row[name]) if value is None else row[name] == value, (row["commit"], name)


def test_the_plot_shows_every_run(tmp_path):
    kept = over_time.history(ROOT)
    text = over_time.page(ROOT)
    assert all(commit in text for commit in kept["commit"]) and f"({over_time.PLOT})" in text
    drawing = ElementTree.fromstring(over_time.plot(ROOT))
    assert drawing.tag.endswith("svg") and over_time.plot(ROOT) == over_time.plot(ROOT)
    marks = [item for item in drawing.iter() if item.tag.endswith("use")]
    shown = sum(int(kept[name].notna().sum()) for names in over_time.PANELS.values() for name in names)
    assert len(marks) >= shown
