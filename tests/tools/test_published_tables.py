"""The tables of a published result: counted by hand from a few trials."""

from __future__ import annotations

import re

import pandas as pd
import pytest

from tools.publish import main
from tools.published_tables import conditions, cost, failures, headline, matrix, single_grasps, with_tables

PARAMETERS = {
    "seed": 1,
    "pairs": "all",
    "styles": {"pinch": ["cube", "train"], "side": ["soda_can"]},
    "train": {"data": {"held_out_pairs": [["train", "soda_can"]]}},
}


def rows(table: str, first: str, outcomes: str) -> list[dict]:
    """One trial per letter: s success, d dropped after the released code's rule was met, p no motion found."""
    reason = {"s": "", "d": "dropped in hold", "p": "plan first"}
    return [
        {
            "table": table,
            "object0": first,
            "object1": "soda_can",
            "trial": number,
            "merged_id": number,
            "success": letter == "s",
            "success_10cm": letter in "sd",
            "reason": reason[letter],
            "planning_attempts": 1,
        }
        for number, letter in enumerate(outcomes)
    ]


@pytest.fixture
def trials() -> pd.DataFrame:
    return pd.DataFrame(
        rows("synthesized", "cube", "sssd")
        + rows("synthesized", "train", "sspd")
        + rows("learned", "cube", "ssss")
        + rows("learned", "train", "sssp")
        + rows("icy", "cube", "sp")
    )


def cells(table: str) -> dict[str, list[str]]:
    """The cells of every row by its first one."""
    lines = [line.strip("|").split("|") for line in table.splitlines() if not set(line) <= set("|- ")]
    return {line[0].strip(): [cell.strip() for cell in line[1:]] for line in lines}


def test_headline_has_ours_beside_the_papers(trials) -> None:
    found = cells(headline(trials, [("cube", "soda_can"), ("train", "soda_can")]))
    assert found["both 20 cm up for 2 s, mean over pairs"] == ["**62.5 %**", "82.7 %", "**87.5 %**", "65.8 %"]
    assert found["worst pair"] == ["50 %", "56 %", "75 %", "not published"]
    assert found["pairs at 100 %"] == ["0", "4", "1", "not published"]
    assert found["more than 10 cm up at the end of the lift (the released code's rule)"][::2] == ["87.5 %", "87.5 %"]
    assert found["no motion found"][::2] == ["1", "1"]
    assert found["pairs, trials"] == ["2, 8", "64, 1600", "2, 8", "64, 1600"]
    # Wilson's interval of 5 of 8, by hand: centre (0.625 + 0.2401) / 1.4802, half 1.96 * 0.2095 / 1.4802.
    assert found["95 % interval of all trials"][0] == "30.6 % to 86.3 %"


def test_matrix_marks_pairs_that_were_never_trained(trials) -> None:
    assert cells(matrix(trials, "synthesized", PARAMETERS)) == {
        "first \\ second": ["soda can"],
        "cube": ["3"],
        "train": ["2"],
    }
    assert cells(matrix(trials, "learned", PARAMETERS))["train"] == ["*3*"]


def test_matrix_leaves_pairs_empty_that_are_not_tried(trials) -> None:
    styles = {"pinch": ["cube", "train"], "side": ["mug", "soda_can"]}
    chosen = PARAMETERS | {"styles": styles, "pairs": [["train", "soda_can"]]}
    found = cells(matrix(trials, "synthesized", chosen))
    assert (found["cube"], found["train"]) == (["", ""], ["", "2"])


def test_single_grasps_are_counted_by_object_and_paid_for_by_style() -> None:
    summary = {}
    for style, name, chains, passed, validated in (
        ("pinch", "cube", 100, 60, 40),
        ("pinch", "train", 100, 50, 20),
        ("side", "soda_can", 200, 0, 0),
    ):
        summary[f"validate.{style}.{name}.optimised"] = chains
        summary[f"synthesize.{style}.{name}.passed"] = passed
        summary[f"validate.{style}.{name}.validated"] = validated
        summary[f"validate.{style}.{name}.survival_rate"] = validated / chains
    durations = {f"{stage}@pinch": {"cpu_seconds": 60.0} for stage in ("synthesize", "validate")}
    found = cells(single_grasps(summary, durations | {"synthesize@side": {"cpu_seconds": 9.0}}, PARAMETERS))
    assert found["cube"] == ["pinch", "100", "60", "40", "40 %", "3.3 %", ""]
    assert found["soda can"][:5] == ["side", "200", "0", "0", "0 %"]
    assert found["**all**"] == ["pinch", "200", "110", "60", "30 %", "", "2.00"]  # none of a side grasp to pay for


def test_reasons_are_counted_per_table(trials) -> None:
    found = cells(failures(trials, ["synthesized", "learned", "icy"]))
    assert found["reason"] == ["SG", "LG", "`icy`"]
    assert found["`dropped in hold`"] == ["2", "0", "0"]
    assert found["`plan first`"] == ["1", "1", "1"]
    assert found["all trials"] == ["8", "8", "2"]


def test_every_source_stands_under_every_condition(trials) -> None:
    series = rows("learned-icy-sapien", "cube", "sp") + rows("reconstructed-icy-sapien", "train", "d")
    section = {"conditions": {"pairs": [["cube", "soda_can"]], "trials": 2}}
    found = cells(conditions(pd.concat([trials[trials["table"] != "icy"], pd.DataFrame(series)]), section))
    titles = [
        "synthesized grasps",
        "grasps of the learned model",
        "grasps of the learned model for reconstructed objects",
    ]
    assert found["condition, engine"] == titles
    # Intervals: Wilson's, 2 of 2, 1 of 2 and 0 of 1, by hand.
    alone = "**100.0 %** (34.2 % to 100.0 %), worst 100 %"
    assert found["`paper`"] == [alone, alone, ""]
    assert found["`icy`, sapien"] == [
        "",
        "**50.0 %** (9.5 % to 90.5 %), worst 50 %",
        "**0.0 %** (0.0 % to 79.3 %), worst 0 %",
    ]


def test_cost_counts_a_stage_once_and_divides_by_trials(trials) -> None:
    one = {"wall_seconds": 60.0, "cpu_seconds": 90.0, "peak_megabytes_largest_process": 500.0}
    names = ["prepare", "synthesize@pinch", "synthesize@side", "validate@pinch", "merge", "train"]
    names += ["sample@learned", "sample@reconstructed", "evaluate@synthesized", "evaluate@learned"]
    names += ["evaluate@reconstructed", "evaluate-conditions"]
    found = cells(cost(dict.fromkeys(names, one) | {"train": one | {"wall_seconds": 120.0}}, trials))
    assert found["`synthesize`"] == ["2", "2.0", "3.0", "1.0 (`synthesize@pinch`)", "0.5"]
    assert found["`merge`"] == ["1", "1.0", "1.5", "1.0 (`merge`)", "0.5"]
    assert found["`train`"] == ["1", "2.0", "1.5", "2.0 (`train`)", "0.5"]
    assert found["`sample`"][:2] == ["1", "1.0"]
    assert found["`evaluate`"][:3] == ["2", "2.0", "3.0"]
    assert found["`evaluate-conditions`"][:1] == ["1"]
    assert found["one standard trial"][2] == "11.25 s"  # 180 s of 16 trials
    assert found["one other trial"][2] == "45.00 s"


def test_a_page_keeps_its_words_and_gets_the_tables() -> None:
    page = (
        "Before\n<!-- table: one -->\nold\n\nolder\n<!-- end -->\nbetween\n<!-- table: two -->\n<!-- end -->\nafter\n"
    )
    written = with_tables(page, {"one": "| a |\n", "two": "| b |\n"})
    assert written == (
        "Before\n<!-- table: one -->\n| a |\n<!-- end -->\nbetween\n<!-- table: two -->\n| b |\n<!-- end -->\nafter\n"
    )
    assert with_tables(written, {"one": "| a |\n", "two": "| b |\n"}) == written


def test_what_is_no_published_result_is_one_sentence(tmp_path, capsys) -> None:
    page = tmp_path / "page.md"
    page.write_text("<!-- table: success -->\n<!-- end -->\n")
    (tmp_path / "results").mkdir()
    assert main([str(tmp_path / "results"), "--page", str(page), "--page-only"]) == 2
    assert re.fullmatch(r".*results is not a published result \(.*\); publish .*\n", capsys.readouterr().err)
    assert page.read_text() == "<!-- table: success -->\n<!-- end -->\n"


def test_an_unfinished_run_is_not_published(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["results"]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert not (tmp_path / "results").exists()
