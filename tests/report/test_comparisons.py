import pandas as pd
import pytest

from pipeline.records.errors import UserError
from pipeline.report.comparisons import (
    ABLATION,
    ABLATION_FILE,
    OBJECTIVES,
    OBJECTIVES_FILE,
    comparison_part,
    read_comparison,
    write_comparison,
)

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
    html = comparison_part("Title", read_comparison(file, OBJECTIVES), OBJECTIVES, "benchmarks/made_up.py", "Words.")
    assert FACTS["command"] in html and FACTS["data"] in html
    assert "&lt;dpm&gt;" in html and "50.0\u202f%" in html and "–" in html and "nan" not in html


def test_where_nothing_is_published_one_sentence_says_so(tmp_path):
    assert read_comparison(tmp_path / "missing.csv", ABLATION) is None
    empty = tmp_path / "empty.csv"
    write_comparison(empty, pd.DataFrame(columns=list(ABLATION)), {})
    for comparison in (None, read_comparison(empty, ABLATION)):
        html = comparison_part("Title", comparison, ABLATION, "benchmarks/made_up.py", "Words.")
        assert "Nothing is published" in html and "<table" not in html


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
