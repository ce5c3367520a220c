"""Layouts of figures against what they are to show; how colours and moments are chosen."""

import io
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from PIL import Image

from pipeline.pictures.colours import fractions, hexadecimal
from pipeline.pictures.decimation import decimated
from pipeline.report.charts import (
    Curves,
    Histogram,
    curves,
    explanations,
    histogram,
    ordered_categories,
    scale_colour,
    stacked_bars,
)
from pipeline.report.chosen_trials import choose_trials, chosen_moments
from pipeline.report.figure_files import contact_sheet, heat_map_picture, success_picture
from pipeline.report.meanings import VALIDATION
from pipeline.report.rates import MOST_PAIRS, PairTrials
from pipeline.report.scene import shape_record, shown_grasps
from pipeline.report.worst import worst_pairs
from tests.report import made_up


def trials(first: str, successes: int, tried: int = 10, second: str = "can") -> PairTrials:
    return PairTrials(first, second, tried, successes, successes, 0, tried, tried, {})


def test_a_histogram_counts_every_value_once():
    values = [0.0, 4.9, 5.0, 99.0, 100.0, 250.0, -3.0]
    found = histogram(values, range(0, 101, 5), "Title", "rate (%)", "pairs")
    assert sum(found.counts) == len(values) and (found.counts[0], found.counts[1], found.counts[-1]) == (3, 1, 3)
    assert [int(row[1]) for row in found.numbers.rows] == list(found.counts)
    heights = [height for _, height, _, _ in found.bars]
    assert max(heights) == Histogram.HEIGHT and sum(heights) == pytest.approx(Histogram.HEIGHT * len(values) / 3)
    assert histogram([], range(0, 101, 5), "Title", "rate (%)", "pairs").most == 1


def test_bars_add_up_to_their_length():
    chart = stacked_bars([("a", {"passed": 1, "x": 3}), ("b", {"y": 2})], "passed", "bars", "pair")
    for bar, shares in zip(chart.bars, ([0.25, 0.75], [1.0]), strict=True):
        assert [part.share for part in bar.segments] == shares
        ends = np.cumsum([chart.LEFT, *(part.width for part in bar.segments)])
        assert ends[-1] == pytest.approx(chart.LEFT + chart.LENGTH)
        assert [part.x for part in bar.segments] == pytest.approx(ends[:-1])
    assert [row[1] for row in chart.numbers.rows] == ["4", "2"] and chart.numbers.rows[1][2].startswith("0 (")
    assert ordered_categories([("b", {"y": 2}), ("a", {"x": 1})], "passed") == ["passed", "x", "y"]


def test_curves_reach_the_edges_of_their_diagram():
    found = curves([1, 2], {"a": [4.0, 1.0], "b": [2.0, 0.0]}, "Losses", "steps")
    right, base = Curves.LEFT + Curves.WIDTH, Curves.TOP + Curves.HEIGHT
    assert found.curves[0].points == [(Curves.LEFT + Curves.WIDTH / 2, Curves.TOP), (right, base - Curves.HEIGHT / 4)]
    assert found.curves[1].points[-1] == (right, base)
    assert found.levels == [(base, 0.0), (base - Curves.HEIGHT / 2, 2.0), (Curves.TOP, 4.0)]


def test_gravity_directions_share_one_line_and_order_is_that_of_the_checks():
    lines = explanations(["table:drop", "gravity:-x", "gravity:+y", "unheard of"], VALIDATION)
    assert [names for names, _ in lines] == ["gravity:+y, gravity:-x", "table:drop"]
    assert all(text in VALIDATION.values() for _, text in lines) and explanations([], VALIDATION) == []


def test_worst_pairs_count_the_trials_of_all_sources():
    sources = {
        "synthesized": [trials("a", 9), trials("b", 5), trials("c", 0, 0)],
        "learned": [trials("a", 3), trials("b", 6)],
    }
    assert [(one.first, one.source, one.successes, one.trials) for one in worst_pairs(sources, most=2)] == [
        ("c", "synthesized", 0, 0),
        ("b", "synthesized", 11, 20),
    ]


def test_decimation_keeps_the_shape():
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=0.03)
    mesh = np.asarray(sphere.vertices), np.asarray(sphere.faces)
    vertices, faces = decimated(mesh, 500)
    assert len(faces) <= 500
    assert np.linalg.norm(vertices, axis=1) == pytest.approx(0.03, rel=0.03)
    assert shape_record((vertices, faces)) == shape_record(decimated(mesh, 500))


def test_grasps_that_the_robot_used_come_first():
    merged = made_up.merged("cube", "can", accepted=5)
    assert shown_grasps(merged, [3, -1, 1], most=4)["merged_id"].tolist() == [3, 1, 0, 2]
    assert len(shown_grasps(merged, [5])) == 5  # the rejected combination is never shown


def test_first_success_and_the_most_common_failure_are_shown():
    rows = made_up.trials("cube", ["can"])
    rows.loc[0, ["success", "reason"]] = [False, "dropped in hold"]
    chosen = choose_trials("cube", "can", rows)
    assert chosen.success is None
    assert chosen.failure is not None and chosen.failure["trial"] == 0
    assert choose_trials("cube", "other", rows).failure is None


def test_moments_keep_the_first_and_the_last():
    phases = [str(index) for index in range(12)]
    assert chosen_moments(phases, 12) == list(range(12))
    assert chosen_moments(phases, 4) == [0, 4, 7, 11]
    assert chosen_moments(phases[:1], 2) == [0]


def test_colours_run_from_pale_to_dark():
    brightness = [sum(scale_colour(rate)) for rate in (0.0, 0.25, 0.5, 0.75, 1.0)]
    assert brightness == sorted(brightness, reverse=True)
    assert fractions(hexadecimal((0.2, 0.4, 1.0))) == (0.2, 0.4, 1.0)


def test_picture_files_are_the_same_every_time():
    pairs = [trials("cube", 3), trials("cube", 0, second="box")]
    first = heat_map_picture(pairs)
    assert first == heat_map_picture(pairs) == success_picture(pairs) and first.startswith(b"\x89PNG")
    many = [replace(pairs[0], first=f"a{index}", second=f"b{index}") for index in range(MOST_PAIRS)]
    assert Image.open(io.BytesIO(success_picture(many))).size[1] < 500, "no map of thousands of cells"
    assert success_picture(many) == success_picture(many)
    sheet = Image.open(io.BytesIO(contact_sheet([np.zeros((64, 64, 3), np.uint8)] * 2, ["settle", "hold"])))
    assert sheet.size == (2 * 64, 64 + 24)
