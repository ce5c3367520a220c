from dataclasses import replace

import pandas as pd
import pytest

from pipeline.records.errors import UserError
from pipeline.report.comparisons import (
    ABLATION,
    ABLATION_FILE,
    OBJECTIVES,
    OBJECTIVES_FILE,
    comparison_table,
    read_comparison,
    write_comparison,
)
from pipeline.report.learned import learned_section
from pipeline.report.wording import UNKNOWN, percent
from tests.report import made_up

FACTS = {"command": "python benchmarks/made_up.py --pairs 2", "data": "tiny scale: 3 grasps", "commit": "abc"}


@pytest.fixture
def file(tmp_path):
    values = [
        {name: "<dpm>" if kind == "word" else 0.5 for name, (_, kind) in OBJECTIVES.items()},
        {name: "a, b" if kind == "word" else float("nan") for name, (_, kind) in OBJECTIVES.items()},
    ]
    target = tmp_path / "made_up.csv"
    write_comparison(target, pd.DataFrame(values), FACTS)
    return target


def test_a_comparison_comes_back_with_how_it_was_made(file):
    comparison = read_comparison(file, OBJECTIVES)
    assert comparison is not None and comparison.facts == FACTS
    assert [row["sampler"] for row in comparison.rows] == ["<dpm>", "a, b"]
    assert comparison.rows[0]["usable"] == 0.5


def test_the_page_names_command_and_data_and_escapes_words(file):
    comparison = read_comparison(file, OBJECTIVES)
    html = learned_section(replace(made_up.learned("cube", ["can"]), objectives=comparison))
    assert FACTS["command"] in html and FACTS["data"] in html and "&lt;dpm&gt;" in html
    table = comparison_table(comparison, OBJECTIVES)
    assert [len(row) for row in table.rows] == [len(OBJECTIVES)] * 2
    assert percent(0.5) in table.rows[0] and set(table.rows[1]) == {"a, b", UNKNOWN}


def test_where_nothing_is_published_there_is_no_table(tmp_path):
    assert read_comparison(tmp_path / "missing.csv", ABLATION) is None
    empty = tmp_path / "empty.csv"
    write_comparison(empty, pd.DataFrame(columns=list(ABLATION)), {})
    for comparison in (None, read_comparison(empty, ABLATION)):
        assert comparison_table(comparison, ABLATION) is None


def test_a_damaged_file_is_refused_in_one_sentence(file):
    file.write_text("# command: x\nobjective,sampler\nclean,dpm\n")
    with pytest.raises(UserError, match=r"damaged \(no column usable\); restore it"):
        read_comparison(file, OBJECTIVES)


@pytest.mark.parametrize(("published", "columns"), [(OBJECTIVES_FILE, OBJECTIVES), (ABLATION_FILE, ABLATION)])
def test_the_published_tables_can_be_read(repository, published, columns):
    comparison = read_comparison(repository / published, columns)
    assert comparison is not None
    assert not comparison.rows or {"command", "data", "commit"} <= set(comparison.facts)
    for row in comparison.rows:
        for name, (_, kind) in columns.items():
            assert kind != "share" or row[name] != row[name] or 0 <= row[name] <= 1
