import base64
import gzip
import io
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
import trimesh
from PIL import Image

from pipeline.pictures.decimation import decimated
from pipeline.records import paths
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.report import ReportParameters
from pipeline.records.poses import pose_matrix
from pipeline.report.charts import heat_map, ordered_categories, scale_colour, stacked_bars, table
from pipeline.report.chosen_trials import choose_trials, chosen_moments
from pipeline.report.figure_files import contact_sheet, heat_map_picture
from pipeline.report.harder import PREFIX
from pipeline.report.page import PageContent, Strip, build_page
from pipeline.report.rates import pair_merge, pair_trials, single_grasp_funnel
from pipeline.report.scene import UNIT, fractions, hexadecimal, shape_record, shown_grasps
from pipeline.report.settings import described
from pipeline.report.summary import summarize
from pipeline.report.tables import Tables
from pipeline.report.trial_rows import trials_table
from tests.browser import needs_chromium, open_tab
from tests.report import made_up

ALL_SOURCES = (*paths.SOURCES, paths.RECONSTRUCTED)


class Balance(HTMLParser):
    """Checks that every element that is opened is closed, in order."""

    EMPTY = {"meta", "img", "br", "link"}

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.texts: list[str] = []

    def handle_starttag(self, tag, attrs):
        if tag not in self.EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)


def parsed(html: str) -> Balance:
    parser = Balance()
    parser.feed(html)
    parser.close()
    assert parser.open == []
    return parser


def embedded(page: str, name: str):
    """What a compressed block of the page holds."""
    (packed,) = re.findall(f'<script type="application/octet-stream" id="{name}">([^<]*)</script>', page)
    return json.loads(gzip.decompress(base64.b64decode(packed)))


class StandIn:
    """What drawing needs of a prepared object."""

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        self.vertices, self.faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)


@pytest.fixture(scope="module")
def tables() -> Tables:
    singles = [("pinch", "cube"), ("side", "can")]
    return Tables(
        candidates={key: made_up.candidates(*key) for key in singles},
        validated={key: made_up.validated(*key) for key in singles},
        merged={("cube", "can"): made_up.merged("cube", "can")},
        trials={(source, "cube"): made_up.trials("cube", ["can"], source) for source in ALL_SOURCES},
    )


@pytest.fixture(scope="module")
def content(tables) -> PageContent:
    from pipeline.report.drawing import draw_views

    objects = {
        "cube": StandIn(trimesh.creation.box((0.04, 0.04, 0.04))),
        "can": StandIn(trimesh.creation.cylinder(radius=0.03, height=0.1)),
    }
    settings = ReportParameters(picture_width=64, picture_height=64, pictures_per_trial=2)
    views, shapes = draw_views(tables, objects, settings, EvaluateParameters(), workers=1)  # type: ignore[arg-type]
    funnels = [single_grasp_funnel(*key, tables.candidates[key], tables.validated[key]) for key in tables.candidates]
    merges = [pair_merge(*key, merged) for key, merged in tables.merged.items()]
    trials = {source: [pair_trials("cube", "can", tables.trials[source, "cube"])] for source in ALL_SOURCES}
    learned = made_up.learned("cube", ["can"])
    harder = made_up.harder("cube", ["can"])
    return PageContent(
        summary=summarize("tiny", funnels, merges, trials, {"demo": made_up.RECONSTRUCTION}, learned),
        funnels=funnels,
        merges=merges,
        trials=trials,
        views=views,
        trial_tables={
            (source, "cube", "can"): trials_table(source, "cube", "can", tables.trials[source, "cube"])
            for source in ALL_SOURCES
        }
        | {(PREFIX + harder.name, "cube", "can"): trials_table(PREFIX + harder.name, "cube", "can", harder.rows)},
        shapes=shapes,
        shape_unit=UNIT,
        success_height=0.2,
        hold_seconds=2.0,
        hand_torque_limit=0.7,
        versions={"python": "3"},
        settings={"report": list(described("report", settings))},
        learned=learned,
        reconstructed=made_up.reconstructed(),
        harder=[harder],
    )


def test_the_page_is_well_formed_and_fetches_nothing(content):
    page = build_page(content, "/* library */")
    parsed(page)
    assert re.findall(r'(?:src|href)="(?!data:|#)[^"]*"', page) == []
    assert embedded(page, "plotly-source") == "/* library */"
    assert page == build_page(content, "/* library */")


def test_the_views_offer_no_button_that_uploads(content):
    page = build_page(content, "")
    (buttons,) = re.findall(r"const buttons = (.*);", page)
    assert set(sum(json.loads(buttons), [])) == {"orbitRotation", "zoom3d", "pan3d", "resetCameraDefault3d"}
    assert "modeBarButtons: buttons" in page and 'plotlyServerURL: ""' in page


def test_the_page_shows_the_pair_its_trials_and_the_paper(content):
    text = " ".join(parsed(build_page(content, "")).texts)
    for words in (
        "cube + can",
        "Trial 0, synthesized grasps, success",
        "Trial 0, grasps of the learned model, success",
        "The learned model",
        "65.8\u202f%",
        "failed: dropped in hold",
        "82.7\u202f%",
        "3.3\u202f%",
        "plan second",
        "no collision-free motion to the second object was found, the first in the hand",
        "an object overlaps or nearly touches a part of the hand that does not hold it",
        "report.picture_width",
        "Most moments shown of a trial, spread evenly over its phases.",
    ):
        assert words in text
    page = build_page(content, "")
    assert 'data-pair="cube--can"' in page
    assert page.count("data:image/webp;base64,") == 1 + len(ALL_SOURCES) * (2 + 2)  # grasp, trials
    assert page.count("data:image/jpeg;base64,") == 2  # capture


def test_objects_from_photos_have_figures_and_pictures(content):
    from dataclasses import replace

    page = build_page(content, "")
    (section,) = re.findall(r'<section id="photos">(.*?)</section>', page, re.DOTALL)
    rows = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in re.findall(r"<tr>(.*?)</tr>", section)]
    assert rows[1][:4] == ["demo", "rendered by computer", "plane sweep and Poisson", "23 of 24"]
    assert rows[1][4:] == ["0.25", "6", "0.10", "0.10"]
    assert rows[3] == ["can (demo)", "4000", "87.5\u202f%", "310", "0.50", "0.45", "0.55", "95.0\u202f%"]
    assert rows[4][4:] == ["–"] * 4  # nobody knows the true box
    assert "photo_&lt;0&gt;: what was found" in section and section.count("data:image/jpeg;base64,") == 2
    assert "Objects from photos" not in build_page(replace(content, reconstructed={}), "")


def test_library_and_data_cannot_end_their_elements(content):
    page = build_page(content, 'x = "</script><b>"')
    parsed(page)
    assert embedded(page, "plotly-source") == 'x = "</script><b>"'


def test_every_cell_of_a_heat_map_leads_to_the_trials_of_its_pair(content, tables):
    page = build_page(content, "")
    cells = re.findall(r'<table class="heat">.*?</table>', page, re.DOTALL)
    assert len(cells) == len(ALL_SOURCES)
    stored = embedded(page, "table-data")
    for source, cell in zip(ALL_SOURCES, cells, strict=True):
        (target,) = re.findall(r'href="#([^"]+)"', cell)
        assert page.count(f'<details class="folded" id="{target}">') == 1
        kind, rows = stored["tables"][target]
        headers = stored["headers"][kind]
        trials = tables.trials[source, "cube"].set_index("trial")
        assert [int(row[0]) for row in rows] == list(trials.index)
        for row in rows:
            told, trial = dict(zip(headers, row, strict=True)), trials.loc[int(row[0])]
            assert told["outcome"] == ("success" if trial["success"] else trial["reason"])
            assert told["seed"] == str(trial["seed"])
            height = trial["height0"]
            assert told["first up (cm)"] == ("–" if height is None else f"{round(100 * height, 1) + 0.0:.1f}")
            assert told["run again"] == f"./dev replay {source}/cube/can/{row[0]}"
    assert set(re.findall(r'href="#([^"]+)"', page)) <= set(re.findall(r' id="([^"]+)"', page))


def test_every_figure_has_its_numbers_as_a_table(content):
    page = build_page(content, "")
    for section in re.findall(r"<section.*?</section>", page, re.DOTALL):
        figures = section.count('<table class="heat">') + section.count("<svg")
        assert section.count('<details class="numbers">') >= figures, section[:80]
        views = section.count('class="view" data-pair')
        assert section.count('id="grasps-') == views
    kind, rows = embedded(page, "table-data")["tables"]["grasps-cube--can"]
    shown = [grasp["merged_id"] for grasp in content.views[0].grasps]
    assert [int(row[0]) for row in rows] == shown


def test_placed_geometry_is_where_the_table_says(content):
    grasp = content.views[0].grasps[0]
    can = next(body for body in grasp["bodies"] if body["shape"] == "object/can")
    assert can["pose"] == pytest.approx(pose_matrix([0.06, -0.05, -0.02], [0.5] * 4)[:3].ravel(), abs=1e-6)
    assert {body["shape"] for body in grasp["bodies"]} <= set(content.shapes)
    extent = np.ptp(np.array(content.shapes["object/cube"]["vertices"]).reshape(-1, 3) * UNIT, axis=0)
    assert extent == pytest.approx([0.04] * 3, abs=1e-4)


def test_an_unsuccessful_pair_still_has_a_page(content, tables):
    from dataclasses import replace

    bare = replace(content.views[0], grasps=[], poster=None, strips=[])
    page = build_page(replace(content, views=[bare], shapes={}), "")
    parsed(page)
    assert "No merged grasp was accepted." in page and "No trial of this pair has pictures." in page


def test_decimation_keeps_the_shape():
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=0.03)
    vertices, faces = decimated((np.asarray(sphere.vertices), np.asarray(sphere.faces)), 500)
    assert len(faces) <= 500
    assert np.linalg.norm(vertices, axis=1) == pytest.approx(0.03, rel=0.03)
    assert shape_record((vertices, faces)) == shape_record(
        decimated((np.asarray(sphere.vertices), np.asarray(sphere.faces)), 500)
    )


def test_grasps_that_the_robot_used_come_first():
    merged = made_up.merged("cube", "can", accepted=5)
    assert shown_grasps(merged, [3, -1, 1], most=4)["merged_id"].tolist() == [3, 1, 0, 2]
    assert len(shown_grasps(merged, [5])) == 5  # the rejected combination is never shown


def test_first_success_and_the_most_common_failure_are_shown():
    trials = made_up.trials("cube", ["can"])
    trials.loc[0, ["success", "reason"]] = [False, "dropped in hold"]
    chosen = choose_trials("cube", "can", trials)
    assert chosen.success is None
    assert chosen.failure is not None and chosen.failure["trial"] == 0
    assert choose_trials("cube", "other", trials).failure is None


def test_moments_keep_the_first_and_the_last():
    phases = [str(index) for index in range(12)]
    assert chosen_moments(phases, 12) == list(range(12))
    assert chosen_moments(phases, 4) == [0, 4, 7, 11]
    assert chosen_moments(phases[:1], 2) == [0]


def test_bars_add_up_to_their_width():
    svg = stacked_bars([("a", {"passed": 1, "x": 3}), ("b", {"y": 2})], "passed", "bars")
    rows: dict[str, float] = {}
    for y, width in re.findall(r'<rect x="[\d.]+" y="(\d+)" width="([\d.]+)" height="20"', svg):
        rows[y] = rows.get(y, 0.0) + float(width)
    assert list(rows.values()) == pytest.approx([640, 640])
    assert ordered_categories([("b", {"y": 2}), ("a", {"x": 1})], "passed") == ["passed", "x", "y"]


def test_names_are_escaped():
    assert "<b>" not in table(["<b>"], [["<b>", "<b>"]], "<b>")
    assert "<i>" not in heat_map(
        ["<i>"], ["<i>"], {("<i>", "<i>"): 0.5}, {("<i>", "<i>"): "<i>"}, {("<i>", "<i>"): "<i>"}
    )


def test_colours_run_from_pale_to_dark():
    brightness = [sum(scale_colour(rate)) for rate in (0.0, 0.25, 0.5, 0.75, 1.0)]
    assert brightness == sorted(brightness, reverse=True)
    assert fractions(hexadecimal((0.2, 0.4, 1.0))) == (0.2, 0.4, 1.0)


def test_picture_files_are_the_same_every_time(content):
    pairs = content.trials["synthesized"]
    first = heat_map_picture(pairs)
    assert first == heat_map_picture(pairs) and first.startswith(b"\x89PNG")
    pictures = [np.zeros((64, 64, 3), np.uint8)] * 2
    sheet = Image.open(io.BytesIO(contact_sheet(pictures, ["settle", "hold"])))
    assert sheet.size == (2 * 64, 64 + 24)
    assert Image.open(io.BytesIO(content.views[0].strips[0].sheet)).size == sheet.size


def test_strips_name_the_outcome(content):
    success, failure, *others = content.views[0].strips
    assert [strip.source for strip in others] == ["learned", "learned", "reconstructed", "reconstructed"]
    for strip in content.views[0].strips:  # as pipeline.evaluate.replay takes it
        assert re.fullmatch(rf"\./dev replay {strip.source}/cube/\w+/\d+", strip.replay), strip.replay
    number = re.match(r"Trial (\d+),", success.title)
    assert number and success.replay.endswith(f"/{number[1]}") and success.replay in build_page(content, "")
    assert isinstance(success, Strip) and not success.failed and failure.failed
    assert success.captions == ["settle", "hold"]


@pytest.mark.render
@needs_chromium
def test_a_browser_draws_the_page_follows_a_cell_and_prints_without_a_network(content, tmp_path):
    from plotly.offline import get_plotlyjs

    (tmp_path / "index.html").write_text(build_page(content, get_plotlyjs()), encoding="utf-8")
    with open_tab(1200, 900) as tab:
        tab.go_to((tmp_path / "index.html").as_uri())
        assert tab.evaluate("window.Plotly === undefined"), "the library is read when a view is seen, and not before"
        tab.evaluate("document.querySelector('table.heat a').click()")
        tab.wait("document.querySelectorAll('#trials-synthesized-cube--can tbody tr').length == 3")
        tab.rest("document.activeElement.matches('summary')")
        top = "document.getElementById('trials-synthesized-cube--can').getBoundingClientRect().top"
        assert 0 <= tab.evaluate(top) + 1 < 900, "the trials are what the window shows"
        assert "./dev replay synthesized/cube/can/0" in tab.evaluate("document.body.innerText")
        tab.evaluate("document.querySelector('.view').scrollIntoView({block: 'center', behavior: 'instant'})")
        tab.wait("document.querySelector('.view .scene canvas')")
        tab.rest()
        tab.take_picture(tmp_path / "seen.png")
        tab.evaluate("window.dispatchEvent(new Event('beforeprint'))")
        tab.call("Emulation.setEmulatedMedia", media="print")
        tab.rest()
        shown = "[...document.querySelectorAll('#pairs img')].every(i => i.naturalWidth && i.offsetWidth)"
        assert tab.evaluate(shown), "pictures stand on paper where a browser turns scenes"
        assert not tab.evaluate("[...document.querySelectorAll('.view .scene')].some(scene => scene.offsetWidth)")
        assert tab.evaluate("[...document.querySelectorAll('details.numbers')].every(fold => fold.open)")
        assert tab.console_errors == [] and tab.failed_requests == []
    colours = np.unique(np.asarray(Image.open(tmp_path / "seen.png").convert("RGB")).reshape(-1, 3), axis=0)
    assert len(colours) > 500, "a scene with light and shade"
