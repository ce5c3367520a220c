import base64
import gzip
import io
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
import trimesh
from PIL import Image

from pipeline.pictures.colours import fractions, hexadecimal
from pipeline.pictures.decimation import decimated
from pipeline.records import paths
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.report import ReportParameters
from pipeline.records.poses import pose_matrix
from pipeline.records.sources import OF_ALL_PAIRS, SOURCES
from pipeline.report.charts import heat_map, histogram, ordered_categories, scale_colour, stacked_bars, table
from pipeline.report.chosen_trials import choose_trials, chosen_moments
from pipeline.report.embedding import FoldedTable
from pipeline.report.figure_files import contact_sheet, heat_map_picture, success_picture
from pipeline.report.harder import PREFIX
from pipeline.report.many import WORST_PAIRS, worst_pairs
from pipeline.report.page import PageContent, Strip, build_page, result_sentence
from pipeline.report.rates import MOST_PAIRS, PairTrials, single_grasp_funnel, wilson_interval
from pipeline.report.scene import UNIT, shape_record, shown_grasps
from pipeline.report.selection import plan
from pipeline.report.settings import described
from pipeline.report.summary import summarize
from pipeline.report.trial_rows import trials_table
from tests.browser import needs_chromium, open_tab
from tests.report import made_up

ALL_SOURCES = tuple(SOURCES)


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


SETTINGS = ReportParameters(picture_width=64, picture_height=64, pictures_per_trial=2)


@pytest.fixture(scope="module")
def trials() -> dict:
    return {source: made_up.trials("cube", ["can"], source) for source in ALL_SOURCES}


@pytest.fixture(scope="module")
def content(trials) -> PageContent:
    from pipeline.report.drawing import PairTask, all_shapes, draw_pair, opening_view

    meshes = trimesh.creation.box((0.04, 0.04, 0.04)), trimesh.creation.cylinder(radius=0.03, height=0.1)
    counts = [one for source in ALL_SOURCES for one in made_up.counts("cube", ["can"], source)]
    counted = {one.source: [one.trials] for one in counts}
    harder = made_up.harder("cube", ["can"])
    planned = plan(counted, [harder], SETTINGS, EvaluateParameters())
    assert (planned.told, planned.opening, planned.worst) == ([], None, [])
    (request,) = planned.shown
    pair = tuple((np.asarray(mesh.vertices), np.asarray(mesh.faces)) for mesh in meshes)
    drawn = draw_pair(PairTask(request, pair, made_up.merged("cube", "can"), trials))  # type: ignore[arg-type]
    funnels = [
        single_grasp_funnel(*key, made_up.candidates(*key), made_up.validated(*key))
        for key in (("pinch", "cube"), ("side", "can"))
    ]
    merges = [one.grasps for one in counts if one.source == "synthesized"]
    learned = made_up.learned("cube", ["can"])
    return PageContent(
        summary=summarize("tiny", funnels, merges, counted, {"demo": made_up.RECONSTRUCTION}, learned),
        funnels=funnels,
        merges=merges,
        trials=counted,
        views=[drawn.view],
        trial_tables={(source, "cube", "can"): rows for source, rows in drawn.tables.items()}
        | {(PREFIX + harder.name, "cube", "can"): trials_table(PREFIX + harder.name, "cube", "can", harder.rows)},
        shapes=all_shapes([drawn]),
        shape_unit=UNIT,
        success_height=0.2,
        hold_seconds=2.0,
        hand_torque_limit=0.7,
        versions={"python": "3"},
        settings={"report": list(described("report", SETTINGS))},
        drift_limit=0.02,
        opening=opening_view([drawn]),
        counts=counts,
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
    assert page.count("data:image/webp;base64,") == 2 + 1 + len(ALL_SOURCES) * (2 + 2)  # on top, grasp, trials
    assert page.count("data:image/jpeg;base64,") == 2  # capture


def test_objects_from_photos_have_figures_and_pictures(content):
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


def test_every_cell_of_a_heat_map_leads_to_the_trials_of_its_pair(content, trials):
    page = build_page(content, "")
    cells = re.findall(r'<table class="heat">.*?</table>', page, re.DOTALL)
    assert len(cells) == len(ALL_SOURCES)
    stored = embedded(page, "table-data")
    for source, cell in zip(ALL_SOURCES, cells, strict=True):
        (target,) = re.findall(r'href="#([^"]+)"', cell)
        assert page.count(f'<details class="folded" id="{target}">') == 1
        kind, rows = stored["tables"][target]
        headers = stored["headers"][kind]
        made = trials[source].set_index("trial")
        assert [int(row[0]) for row in rows] == list(made.index)
        for row in rows:
            told, trial = dict(zip(headers, row, strict=True)), made.loc[int(row[0])]
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


def test_an_unsuccessful_pair_still_has_a_page(content):
    bare = replace(content.views[0], grasps=[], poster=None, strips=[])
    page = build_page(replace(content, views=[bare], shapes={}), "")
    parsed(page)
    assert "No merged grasp was accepted." in page and "No trial of this pair has pictures." in page


def test_a_trial_and_the_result_come_before_any_number(content):
    page = build_page(content, "")
    (header,) = re.findall(r"<header>(.*?)</header>", page, re.DOTALL)
    texts = parsed(header).texts
    words = [" ".join(text.split()) for text in texts if text.strip()]
    first_number = next(index for index, text in enumerate(words) if re.search(r"\d", text))
    assert words[:first_number] == [
        "One hand, two objects, one after the other",
        *["settle", "hold"],
        "A trial of the simulated robot: first the cube, then the can.",
        "The robot lifted both objects in",
    ]
    (sentence,) = re.findall(r'<p class="result">(.*?)</p>', header)
    low, high = (100 * end for end in wilson_interval(1, 3))
    assert sentence.count(f"of 3 trials with synthesized grasps (95\u202f% interval {low:.1f}–{high:.1f}\u202f%)") == 1
    rows = re.findall(r'<div class="tiles">.*?</div>\n', header, re.DOTALL)
    assert 1 <= rows[0].count('class="tile') - 1 <= 6 and len(rows) == 2
    assert header.index(rows[0]) < header.index("<details") < header.index(rows[1])


def test_without_a_success_the_page_has_no_picture_on_top(content):
    page = build_page(replace(content, opening=None), "")
    assert 'class="opening"' not in page and parsed(page)
    nothing = {source: [replace(pair, trials=0, successes=0) for pair in own] for source, own in content.trials.items()}
    assert "No trial was made." in result_sentence(nothing)


def many_content(content: PageContent, count: int) -> PageContent:
    """So many pairs of two sources, and the few reconstructed ones: of `first_3` none succeeds, of all others one."""
    counts = [
        one
        for source in OF_ALL_PAIRS
        for index in range(count)
        for one in made_up.counts(f"first_{index}", [f"second_{index}"], source)
    ]
    trials = {source: [one.trials for one in counts if one.source == source] for source in OF_ALL_PAIRS}
    trials["learned"][3] = replace(trials["learned"][3], successes=0)
    trials[paths.RECONSTRUCTED] = content.trials[paths.RECONSTRUCTED]
    planned = plan(trials, content.harder, SETTINGS, EvaluateParameters())
    merges = [one.grasps for one in counts if one.source == "synthesized"]
    names = [f"first_{index}" for index in range(count)]
    funnels = [replace(content.funnels[0], object_name=name) for name in names]
    learned = made_up.learned("first_0", ["second_0"])
    learned = replace(
        learned,
        quality={(one.first, one.second): learned.quality["first_0", "second_0"] for one in merges},
        samples=merges,
    )
    told = {
        (source, request.first, request.second): FoldedTable(("trial", "outcome"), [["0", "success"]])
        for request in [*planned.shown, *planned.told]
        for source in request.told
    }
    return replace(
        content,
        summary=summarize("tiny", funnels, merges, trials, {}, learned),
        funnels=funnels,
        merges=merges,
        trials=trials,
        views=[
            replace(
                content.views[0],
                first=one.first,
                second=one.second,
                strips=[strip for strip in content.views[0].strips if (strip.source, strip.failed) in one.strips],
            )
            for one in planned.shown
        ],
        trial_tables=told | {key: rows for key, rows in content.trial_tables.items() if key[0].startswith(PREFIX)},
        counts=counts,
        worst=planned.worst,
        learned=learned,
    )


def test_the_page_of_many_pairs_shows_the_worst_of_them(content):
    many = many_content(content, 2 * MOST_PAIRS)
    page = build_page(many, "")
    parsed(page)
    assert (many.worst[0].first, many.worst[0].source) == ("first_3", "learned")
    assert len(many.views) == len(many.worst) == WORST_PAIRS
    assert page.count('class="view" data-pair') == WORST_PAIRS
    shown = {f"first_{index}" for index in range(WORST_PAIRS)}  # the others are equal, so the order decides
    assert set(re.findall(r'data-pair="(first_\d+)--', page)) == shown
    assert re.findall(r'href="(?!data:|#)([^"]*)"', page) == ["pairs.parquet"] * 3
    assert set(re.findall(r'href="#([^"]+)"', page)) <= set(re.findall(r' id="([^"]+)"', page))
    assert page.count('<table class="heat">') == 1, "only of the few reconstructed pairs"
    for section in re.findall(r"<section.*?</section>", page, re.DOTALL):
        figures = section.count('<table class="heat">') + section.count("<svg")
        assert section.count('<details class="numbers">') >= figures, section[:80]


def test_the_page_of_many_pairs_has_a_table_of_all_objects(content):
    tables = embedded(build_page(many_content(content, 2 * MOST_PAIRS), ""), "table-data")
    kind, rows = tables["tables"]["objects-learned-first"]
    assert len(rows) == 2 * MOST_PAIRS and rows[0][0] == "first 3"
    assert dict(zip(tables["headers"][kind], rows[0], strict=True))["success"] == "0.0\u202f%"
    assert len(tables["tables"]["singles-pinch"][1]) == 2 * MOST_PAIRS


def test_the_page_does_not_grow_with_pairs_that_it_does_not_show(content):
    lengths = [len(build_page(many_content(content, factor * MOST_PAIRS), "")) for factor in (2, 6)]
    assert lengths[1] - lengths[0] < 100 * 4 * MOST_PAIRS, "an object has some letters in a folded table"


def test_worst_pairs_count_the_trials_of_all_sources():
    def pair(first: str, successes: int, trials: int = 10) -> PairTrials:
        return PairTrials(first, "can", trials, successes, successes, 0, trials, trials, {})

    found = worst_pairs(
        {"synthesized": [pair("a", 9), pair("b", 5), pair("c", 0, 0)], "learned": [pair("a", 3), pair("b", 6)]}, most=2
    )
    assert [(one.first, one.source, one.successes, one.trials) for one in found] == [
        ("c", "synthesized", 0, 0),
        ("b", "synthesized", 11, 20),
    ]


def test_pairs_that_something_leads_to_are_told_though_not_drawn():
    def pairs(names: list[str], successes: int) -> list[PairTrials]:
        return [PairTrials(name, "can", 2, successes, 0, 0, 2, 2, {}) for name in names]

    names = [f"a{index}" for index in range(MOST_PAIRS + 1)]
    trials = {"synthesized": pairs(names, 1), "reconstructed": pairs([names[-1], "other"], 2)}
    planned = plan(trials, [], SETTINGS, EvaluateParameters())
    assert [request.first for request in planned.shown] == names[:WORST_PAIRS]
    assert [(request.first, request.told, request.strips) for request in planned.told] == [
        (names[-1], ("reconstructed",), ()),
        ("other", ("reconstructed",), ()),
    ]
    assert planned.opening is not None and planned.opening.strips == (("synthesized", False),)
    assert all(request.strips == (("synthesized", True),) for request in planned.shown)


def test_long_settings_are_shortened(content):
    rows = [(f"objects.o{index}.density", "5", "") for index in range(1000)]
    page = build_page(replace(content, settings={"objects": rows, "run": [("pairs", "x" * 5000, "")]}), "")
    assert "880 more values" in page and "(5000 letters)" in page and "x" * 500 not in page


def test_a_histogram_counts_every_value_once():
    values = [0.0, 4.9, 5.0, 99.0, 100.0, 250.0, -3.0]
    html = histogram(values, range(0, 101, 5), "Title", "rate (%)", "pairs")
    parsed(html)
    cells = re.findall(r'<th scope="row">([^<]*)</th><td>(\d+)</td>', html)
    found = {name: int(count) for name, count in cells}
    assert sum(found.values()) == len(values)
    assert (found["0 to 5"], found["5 to 10"], found["95 to 100"]) == (3, 1, 3)
    heights = [float(height) for height in re.findall(r'height="([\d.]+)" fill', html)]
    assert max(heights) == 150 and sum(heights) == pytest.approx(150 * len(values) / 3)
    parsed(histogram([], range(0, 101, 5), "Title", "rate (%)", "pairs"))


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
    assert success_picture(pairs) == first
    many = [replace(pairs[0], first=f"a{index}", second=f"b{index}") for index in range(MOST_PAIRS)]
    assert Image.open(io.BytesIO(success_picture(many))).size[1] < 500, "no map of thousands of cells"
    assert success_picture(many) == success_picture(many)
    pictures = [np.zeros((64, 64, 3), np.uint8)] * 2
    sheet = Image.open(io.BytesIO(contact_sheet(pictures, ["settle", "hold"])))
    assert sheet.size == (2 * 64, 64 + 24)
    assert Image.open(io.BytesIO(content.views[0].strips[0].sheet)).size == sheet.size


def test_strips_name_the_outcome(content):
    success, failure, *others = content.views[0].strips
    assert [strip.source for strip in others] == ["learned", "learned", "reconstructed", "reconstructed"]
    for strip in content.views[0].strips:  # as pipeline.replay takes it
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
