"""The published result: its page holds its own figures, and these agree with each other."""

from __future__ import annotations

import json

import pandas as pd
import pytest

from tools.publish import tables_of
from tools.published_tables import with_tables


def test_the_published_page_holds_the_published_figures(repository) -> None:
    folder = repository / "results/paper"
    page = (repository / "docs/results.md").read_text()
    assert "<!-- table: success -->" in page and with_tables(page, tables_of(folder)) == page


def test_published_trials_agree_with_the_published_summary(repository) -> None:
    folder = repository / "results/paper"
    summary = json.loads((folder / "summary.json").read_text())
    trials = pd.read_csv(folder / "trials.csv", keep_default_na=False)
    for source in ("synthesized", "learned"):
        own = trials[trials["table"] == source]
        rates = own.groupby(["object0", "object1"])["success"].mean()
        assert (len(own), len(rates)) == (1600, 64)
        assert rates.mean() == pytest.approx(summary[f"evaluate.{source}.success_rate_mean"], abs=1e-5)
        assert rates.min() == pytest.approx(summary[f"evaluate.{source}.success_rate_min_pair"], abs=1e-5)
