"""The data card tells what the tables hold, and its example runs."""

import contextlib
import io
import re

import numpy as np
import pytest

from pipeline.records import paths
from pipeline.records.tables import MERGED, write_table
from pipeline.report.dataset_card import (
    CardContent,
    ObjectFacts,
    dataset_card,
    description_of,
    parameters_digest,
    type_name,
)
from pipeline.report.diversity import compass_sectors, diversity, pair_diversity, used_grasps
from pipeline.report.rates import pair_merge, single_grasp_funnel
from pipeline.report.tables import Tables
from tests.report import made_up

SIDES = ["can", "box"]


@pytest.fixture(scope="module")
def tables() -> Tables:
    singles = [("pinch", "cube"), *(("side", name) for name in SIDES)]
    return Tables(
        candidates={key: made_up.candidates(*key) for key in singles},
        validated={key: made_up.validated(*key) for key in singles},
        merged={
            ("cube", name): made_up.merged("cube", name, accepted) for name, accepted in zip(SIDES, (2, 0), strict=True)
        },
        trials={},
    )


@pytest.fixture(scope="module")
def content(tables) -> CardContent:
    used, pairs = diversity(tables)
    return CardContent(
        scale="tiny",
        seed=3,
        funnels=[single_grasp_funnel(*key, rows, tables.validated[key]) for key, rows in tables.candidates.items()],
        merges=[pair_merge(*key, rows) for key, rows in tables.merged.items()],
        used=used,
        diversity=pairs,
        distinct_distance=0.003,
        objects=[ObjectFacts("cube", "recipe box", "own work, MIT", [0.042, 0.042, 0.042], 0.037)],
        columns=MERGED,
        versions={"python": "3.11", "sapien": "3"},
        settings={"run": [("scale", "tiny", ""), ("seed", "3", "")]},
    )


def tables_of(card: str) -> list[list[list[str]]]:
    """All tables of the card: lines of cells."""
    blocks = re.findall(r"(?:^\|.*\|\n)+", card, flags=re.MULTILINE)
    return [[line.strip("|").split(" | ") for line in block.splitlines()] for block in blocks]


def test_counts_and_shares_are_those_of_the_tables(content):
    card = dataset_card(content)
    counts, rates, singles, *_ = tables_of(card)
    assert [cell.strip() for cell in counts[2]] == ["cube", "2", "0"]
    assert [cell.strip() for cell in rates[2]] == ["cube", "66.7 %", "0.0 %"]
    assert [cell.strip() for cell in singles[2][:4]] == ["cube (pinch)", "4", "2", "1"]  # both merged grasps use one
    assert "2 two-object grasps of 2 pairs, at least 0 per pair" in card
    assert "`merge`: 4 combinations tried, 50.0 % accepted." in card
    assert "| `hand_clearance` | 50.0 % |" in card


def test_the_card_is_well_formed_and_the_same_each_time(content):
    card = dataset_card(content)
    assert card == dataset_card(content) and card.endswith(".\n") and "\n\n\n" not in card
    for rows in tables_of(card):
        assert len({len(row) for row in rows}) == 1 and set("".join(rows[1])) <= set("-: ")
    prose = re.sub(r"```.*?```", "", card, flags=re.DOTALL)
    assert [line for line in prose.splitlines() if len(line) > 120 and not line.startswith("|")] == []
    assert re.findall(r"\b(?:nan|None)\b", card) == []


def test_every_column_is_described_with_its_type(content):
    card = dataset_card(content)
    for field in MERGED:
        assert description_of(field), field.name
        assert f"| `{field.name}` | `{type_name(field.type)}` | {description_of(field)} |" in card
    assert type_name(MERGED.field("q").type) == "double[16]" and type_name(MERGED.field("open_q1").type) == "double[]"


def test_links_lead_to_files(content, repository):
    links = re.findall(r"\]\(([^)]+)\)", dataset_card(content))
    assert links and all((repository / "reports" / link).resolve().is_file() for link in links)


def test_the_example_runs_on_tables_as_they_are_written(content, tables, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for (first, second), rows in tables.merged.items():
        write_table(paths.merged_file(first, second), rows, MERGED)
    (example,) = re.findall(r"```python\n(.*?)```", dataset_card(content), flags=re.DOTALL)
    scope: dict = {}
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(example, scope)
    assert len(scope["tried"]) == 4 and len(scope["grasps"]) == 2 and scope["q"].shape == (2, 16)
    assert re.search(r"^cube +2", printed.getvalue(), re.MULTILINE)
    assert len([line for line in example.splitlines() if line]) <= 8


def test_the_digest_follows_values_of_the_data_alone():
    settings = {"merge": [("merge.clearance", "0.001", "meaning")], "report": [("report.width", "640", "")]}
    same = {"merge": [("merge.clearance", "0.001", "other words")], "report": [("report.width", "320", "")]}
    other = {"merge": [("merge.clearance", "0.002", "meaning")]}
    assert parameters_digest(settings) == parameters_digest(same) != parameters_digest(other)


def test_sectors_of_the_compass():
    angles = np.deg2rad([0, 29, 31, 179, 181, 359, -1])
    assert compass_sectors(np.cos(angles), np.sin(angles)).tolist() == [0, 0, 1, 5, 6, 11, 11]


def moved_grasps(style: str, name: str, shifts: list[list[float]]):
    """Validated grasps that differ by a shift of the hand alone, m, in the object's frame."""
    rows = made_up.validated(style, name).iloc[[0] * len(shifts)].reset_index(drop=True)
    rows["grasp_id"] = range(len(shifts))
    rows["position_object_hand"] = [list(np.add([0.1, 0.0, 0.0], shift)) for shift in shifts]
    return rows


def test_distances_are_those_of_the_shifts():
    table = moved_grasps("pinch", "cube", [[0, 0, 0], [0, 0.004, 0], [0.003, 0, 0.004]])
    used = used_grasps("pinch", "cube", table, [0, 2])
    assert used.grasp_ids.tolist() == [0, 2] and used.validated == 3
    np.testing.assert_allclose(used.distances, [[0, 0.005], [0.005, 0]], atol=1e-12)
    np.testing.assert_allclose(used.approach_elevations, np.arcsin(0.8))


def test_merged_grasps_differ_by_the_larger_difference_of_their_halves():
    firsts = used_grasps("pinch", "cube", moved_grasps("pinch", "cube", [[0, 0, 0], [0, 0.004, 0]]), [0, 1])
    seconds = used_grasps("side", "can", moved_grasps("side", "can", [[0, 0, 0], [0, 0, 0.02]]), [0, 1])
    merged = made_up.merged("cube", "can", accepted=3)
    merged["grasp0_id"], merged["grasp1_id"] = [0, 1, 0, 0], [0, 0, 1, 0]
    pair = pair_diversity(merged, firsts, seconds)
    assert (pair.grasps, pair.pinch_grasps, pair.side_grasps, pair.most_uses) == (3, 2, 2, 2)
    assert pair.closest == pytest.approx(0.004) and pair.typical == pytest.approx(0.02)


def test_a_pair_without_grasps_has_no_distance(tables):
    empty = next(pair for pair in diversity(tables)[1] if pair.second == "box")
    assert empty.grasps == 0 and np.isnan(empty.closest) and empty.most_uses == 0
