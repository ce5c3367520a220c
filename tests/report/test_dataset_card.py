"""The data card tells what the tables hold, and its example runs."""

import contextlib
import io
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pipeline.hand.model import load_hand
from pipeline.records import paths
from pipeline.records.flat import PAIR_GRASPS
from pipeline.records.tables import MERGED
from pipeline.report.counting import PairCounts, Single, pair_counts
from pipeline.report.dataset_card import CardContent, dataset_card, description_of, parameters_digest, type_name
from pipeline.report.diversity import compass_sectors, diversity, pair_diversity, used_grasps
from pipeline.report.objects import ObjectFacts
from pipeline.report.pairs_table import uses
from pipeline.report.rates import MOST_PAIRS, single_grasp_funnel
from tests.pairs import write_pairs
from tests.report import made_up

HAND = load_hand("allegro")
SIDES = ["can", "box"]


SINGLES = [Single("pinch", "cube"), *(Single("side", name) for name in SIDES)]
OBJECT = ObjectFacts("cube", "recipe box", "own work, MIT", [0.042, 0.042, 0.042], 0.037)


def merged_tables() -> list:
    """The tables of both pairs: two grasps of the first, none of the second."""
    return [made_up.merged("cube", name, accepted) for name, accepted in zip(SIDES, (2, 0), strict=True)]


@pytest.fixture(scope="module")
def counts() -> list[PairCounts]:
    trials = made_up.trials("cube", SIDES)
    return [
        pair_counts("synthesized", "cube", name, rows, trials)
        for name, rows in zip(SIDES, merged_tables(), strict=True)
    ]


@pytest.fixture(scope="module")
def content(counts) -> CardContent:
    validated = {one: made_up.validated(one.style, one.object_name) for one in SINGLES}
    used, pairs = diversity(counts, validated, HAND)
    return CardContent(
        scale="tiny",
        seed=3,
        funnels=[
            single_grasp_funnel(
                one.style, one.object_name, made_up.candidates(one.style, one.object_name), validated[one]
            )
            for one in SINGLES
        ],
        merges=[one.grasps for one in counts],
        used=used,
        diversity=pairs,
        uses=[uses(one) for one in counts],
        distinct_distance=0.003,
        objects=[OBJECT],
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
    assert re.search(r"\n2 two-object grasps of 2 pairs\b.*\b0 per pair", card)
    assert re.search(r"`merge`: 4 .* 50\.0 %", card)
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
    assert (
        type_name(MERGED.field("q").type) == "double[16]" and type_name(MERGED.field("open_q").type) == "double[16][]"
    )


def test_links_lead_to_files(content, repository):
    links = re.findall(r"\]\(([^)]+)\)", dataset_card(content))
    assert links and all((repository / "reports" / link).resolve().is_file() for link in links)


def test_the_example_runs_on_tables_as_they_are_written(content, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_pairs(paths.merged_file("cube"), pd.concat(merged_tables(), ignore_index=True), PAIR_GRASPS)
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
    used = used_grasps(HAND, "pinch", "cube", table, [0, 2])
    assert used.grasp_ids.tolist() == [0, 2] and used.validated == 3
    np.testing.assert_allclose(used.distances, [[0, 0.005], [0.005, 0]], atol=1e-12)
    np.testing.assert_allclose(used.approach_elevations, np.arcsin(0.8))


def test_merged_grasps_differ_by_the_larger_difference_of_their_halves():
    firsts = used_grasps(HAND, "pinch", "cube", moved_grasps("pinch", "cube", [[0, 0, 0], [0, 0.004, 0]]), [0, 1])
    seconds = used_grasps(HAND, "side", "can", moved_grasps("side", "can", [[0, 0, 0], [0, 0, 0.02]]), [0, 1])
    merged = made_up.merged("cube", "can", accepted=3)
    merged["grasp0_id"], merged["grasp1_id"] = [0, 1, 0, 0], [0, 0, 1, 0]
    counted = pair_counts("synthesized", "cube", "can", merged, made_up.trials("cube", ["can"]))
    assert uses(counted) == (2, 2, 2)
    pair = pair_diversity(counted, firsts, seconds)
    assert (pair.grasps, pair.pinch_grasps, pair.side_grasps, pair.most_uses) == (3, 2, 2, 2)
    assert pair.closest == pytest.approx(0.004) and pair.typical == pytest.approx(0.02)


def test_a_pair_without_grasps_has_no_distance(content, counts):
    empty = next(pair for pair in content.diversity if pair.second == "box")
    assert empty.grasps == 0 and np.isnan(empty.closest) and empty.most_uses == 0
    assert uses(counts[1]) == (0, 0, 0)


def test_the_card_of_many_pairs_tells_distributions(content, counts):
    many = MOST_PAIRS + 1
    objects = [replace(OBJECT, name=f"box_{index}", licence=("MIT", "CC BY 4.0")[index % 2]) for index in range(many)]
    accepted = [2] * (many - 1) + [10]
    large = replace(
        content,
        merges=[replace(content.merges[0], accepted=number) for number in accepted],
        used=[],
        diversity=[],
        uses=[(number, 1, number) for number in accepted],
        objects=objects,
    )
    card = dataset_card(large)
    assert f"{2 * many + 8} two-object grasps of {many} pairs" in card
    found = {row[0].strip(" `"): row for rows in tables_of(card) for row in rows}
    assert float(found["accepted grasps"][1]) == pytest.approx((2 * many + 8) / many, abs=0.05)
    assert [float(cell.strip(" |")) for cell in found["distinct pinch grasps"][2:]] == [2, 2, 2, 2, 10]
    assert found["MIT"][1] == "33" and found["CC BY 4.0"][1] == "32"
    assert len(card) < 1.5 * len(dataset_card(content)), "it does not grow with the number of pairs"
