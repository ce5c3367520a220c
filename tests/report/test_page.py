import base64
import gzip
import io
import json
import re
import shutil
import tomllib
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
import trimesh
from markupsafe import Markup
from PIL import Image

from pipeline.provenance.lines import code_lines
from pipeline.records import paths
from pipeline.records.opening_film import OpeningFilm
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.report import ReportParameters
from pipeline.records.poses import pose_matrix
from pipeline.records.series import series_of
from pipeline.records.sources import OF_ALL_PAIRS, SOURCES
from pipeline.report import paper
from pipeline.report.conditions import Conditions
from pipeline.report.content import PageContent, series_tables
from pipeline.report.embedding import FoldedTable
from pipeline.report.headline import MOST_TILES, results
from pipeline.report.meanings import MERGE, TRIALS
from pipeline.report.page import build_page
from pipeline.report.rates import MOST_PAIRS, PairTrials, single_grasp_funnel, wilson_interval
from pipeline.report.rendering import TEMPLATES
from pipeline.report.scene import UNIT
from pipeline.report.selection import plan
from pipeline.report.settings import MOST_LETTERS, MOST_ROWS, described
from pipeline.report.summary import summarize
from pipeline.report.wording import percent
from pipeline.report.worst import WORST_PAIRS
from tests.browser import needs_chromium, open_tab
from tests.report import made_up

ALL_SOURCES = tuple(SOURCES)


class Balance(HTMLParser):
    """Checks that every element that is opened is closed, in order."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.open += [] if tag in ("meta", "img", "br", "link") else [tag]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def check(page: str, elsewhere: int = 0) -> None:
    """Any page is well-formed and whole: links lead to its own elements, and figures have their numbers as tables."""
    Balance(page)
    assert re.findall(r'(?:src|href)="(?!data:|#)([^"]*)"', page) == ["pairs.parquet"] * elsewhere
    assert set(re.findall(r'href="#([^"]+)"', page)) <= set(re.findall(r' id="([^"]+)"', page))
    for section in re.findall(r"<section.*?</section>", page, re.DOTALL):
        figures = section.count('<table class="heat">') + section.count("<svg")
        assert section.count('<details class="numbers">') >= figures, section[:80]
        assert section.count('id="grasps-') == section.count('class="view" data-pair')


def embedded(page: str, name: str):
    """What a compressed block of the page holds."""
    (packed,) = re.findall(f'<script type="application/octet-stream" id="{name}">([^<]*)</script>', page)
    return json.loads(gzip.decompress(base64.b64decode(packed)))


FILM = OpeningFilm("synthesized", ("cube", "can"), 0, b"\0\0\0\x20ftypisom")
SETTINGS = ReportParameters(picture_width=64, picture_height=64, pictures_per_trial=2)


@pytest.fixture(scope="module")
def trials() -> dict:
    return {source: made_up.trials("cube", ["can"], source) for source in ALL_SOURCES}


@pytest.fixture(scope="module")
def content(trials) -> PageContent:
    from pipeline.hand.model import load_hand
    from pipeline.report.drawing import PairTask, all_shapes, draw_pair, opening_view

    hand = load_hand("allegro")

    meshes = trimesh.creation.box((0.04, 0.04, 0.04)), trimesh.creation.cylinder(radius=0.03, height=0.1)
    counts = [one for source in ALL_SOURCES for one in made_up.counts("cube", ["can"], source)]
    counted = {one.source: [one.trials] for one in counts}
    tried = made_up.tried("cube", ["can"])
    planned = plan(counted, [tried], SETTINGS, EvaluateParameters(), FILM)
    assert (planned.listed, planned.opening, planned.worst) == ([], None, [])
    (request,) = planned.shown
    pair = tuple((np.asarray(mesh.vertices), np.asarray(mesh.faces)) for mesh in meshes)
    drawn = draw_pair(PairTask(request, hand, pair, made_up.merged("cube", "can"), trials))  # type: ignore[arg-type]
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
        trial_tables={(source, "cube", "can"): rows for source, rows in drawn.tables.items()} | series_tables([tried]),
        shapes=all_shapes([drawn], hand),
        shape_unit=UNIT,
        success_height=0.2,
        hold_seconds=2.0,
        hand_torque_limit=0.7,
        versions={"python": "3"},
        settings={"report": list(described("report", SETTINGS))},
        drift_limit=0.02,
        film=FILM,
        opening=opening_view([drawn], FILM),
        counts=counts,
        learned=learned,
        reconstructed=made_up.reconstructed(),
        conditions=Conditions([tried], made_up.CHANGES),
    )


LIBRARY = 'x = "</script><b>"'


@pytest.fixture(scope="module")
def page(content) -> str:
    return build_page(content, LIBRARY)


def test_the_page_is_well_formed_the_same_each_time_and_uploads_nothing(content, page):
    check(page)
    assert page == build_page(content, LIBRARY)
    assert embedded(page, "plotly-source") == LIBRARY
    (buttons,) = re.findall(r"const buttons = (.*);", page)
    assert set(sum(json.loads(buttons), [])) == {"orbitRotation", "zoom3d", "pan3d", "resetCameraDefault3d"}
    assert "modeBarButtons: buttons" in page and 'plotlyServerURL: ""' in page


def test_the_page_shows_the_pair_its_trials_and_the_paper(content, page):
    text = Markup(page).striptags()
    for shown in (
        *(strip.title for strip in content.views[0].strips),
        *map(percent, (*paper.MEAN_SUCCESS.values(), paper.SINGLE_GRASP_SUCCESS["pinch"]["cube"])),
        *(TRIALS["plan second"], TRIALS["dropped in hold"], MERGE["hand_clearance"]),
        *(cell for row in content.settings["report"] for cell in row),
    ):
        assert " ".join(shown.split()) in text
    assert 'data-pair="cube--can"' in page
    assert page.count("data:image/webp;base64,") == 2 + 1 + len(ALL_SOURCES) * (2 + 2)  # on top, grasp, trials
    assert page.count("data:image/jpeg;base64,") == 2  # capture


def test_objects_from_photos_have_figures_and_pictures(content, page):
    (section,) = re.findall(r'<section id="photos">(.*?)</section>', page, re.DOTALL)
    rows = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in re.findall(r"<tr>(.*?)</tr>", section)]
    assert rows[1][0] == "demo" and rows[1][3] == "23 of 24"
    assert rows[1][4:] == ["0.25", "6", "0.10", "0.10"]
    assert rows[3] == ["can (demo)", "4000", "87.5\u202f%", "310", "0.50", "0.45", "0.55", "95.0\u202f%"]
    assert rows[4][4:] == ["–"] * 4  # nobody knows the true box
    assert "photo_&lt;0&gt;" in section and section.count("data:image/jpeg;base64,") == 2
    assert 'id="photos"' not in build_page(replace(content, reconstructed={}), "")


def test_every_cell_of_a_heat_map_leads_to_the_trials_of_its_pair(page, trials):
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
            shown, trial = dict(zip(headers, row, strict=True)), made.loc[int(row[0])]
            assert shown["outcome"] == ("success" if trial["success"] else trial["reason"])
            assert shown["seed"] == str(trial["seed"])
            height = trial["height0"]
            assert shown["first up (cm)"] == ("–" if height is None else f"{round(100 * height, 1) + 0.0:.1f}")
            assert shown["run again"] == f"./dev replay {source}/cube/can/{row[0]}"


def test_placed_geometry_is_where_the_table_says(content, page):
    _, rows = embedded(page, "table-data")["tables"]["grasps-cube--can"]
    assert [int(row[0]) for row in rows] == [grasp["merged_id"] for grasp in content.views[0].grasps]
    grasp = content.views[0].grasps[0]
    can = next(body for body in grasp["bodies"] if body["shape"] == "object/can")
    assert can["pose"] == pytest.approx(pose_matrix([0.06, -0.05, -0.02], [0.5] * 4)[:3].ravel(), abs=1e-6)
    assert {body["shape"] for body in grasp["bodies"]} <= set(content.shapes)
    extent = np.ptp(np.array(content.shapes["object/cube"]["vertices"]).reshape(-1, 3) * UNIT, axis=0)
    assert extent == pytest.approx([0.04] * 3, abs=1e-4)


def test_a_run_without_grasps_or_successes_has_a_page(content):
    bare = replace(content.views[0], grasps=[], poster=None, strips=[])
    nothing = {source: [replace(pair, trials=0, successes=0) for pair in own] for source, own in content.trials.items()}
    page = build_page(replace(content, views=[bare], shapes={}, film=None, opening=None, trials=nothing), "")
    check(page)
    assert 'id="pair-cube--can"' in page and "data-pair" not in page.split("<script>")[0]
    assert results(nothing) == [] and 'class="opening"' not in page


def test_a_trial_and_the_result_come_before_the_other_figures(page):
    (header,) = re.findall(r"<header>(.*?)</header>", page, re.DOTALL)
    rows = re.findall(r'<div class="tiles">.*?</div>\n', header, re.DOTALL)
    assert 1 <= rows[0].count('class="tile') - 1 <= MOST_TILES and len(rows) == 2
    places = [
        header.index(part)
        for part in ('class="opening"', "<video", 'class="strip"', 'class="result"', rows[0], "<details", rows[1])
    ]
    assert places == sorted(places)
    (sentence,) = re.findall(r'<p class="result">(.*?)</p>', header, re.DOTALL)
    low, high = (f"{100 * end:.1f}" for end in wilson_interval(1, 3))
    assert sentence.count(f"{low}–{high}\u202f%") == sentence.count("of 3 trials") == len(ALL_SOURCES)


def test_the_page_opens_with_the_film_and_pictures_of_the_same_trial(content, page):
    (header,) = re.findall(r"<header>(.*?)</header>", page, re.DOTALL)
    assert f'src="data:video/mp4;base64,{base64.b64encode(FILM.video).decode()}"' in header
    assert "./dev replay synthesized/cube/can/0" in header
    assert content.opening.strips[0].trial == 0 and header.count("<img") == len(content.opening.strips[0].pictures)
    other = build_page(replace(content, opening=None), "")
    (header,) = re.findall(r"<header>(.*?)</header>", other, re.DOTALL)
    assert "<video" in header and 'class="strip"' not in header


def test_names_are_escaped(content):
    names = {"first": "<i>", "second": '"<b>'}
    page = build_page(
        replace(
            content,
            trials={source: [replace(pair, **names) for pair in own] for source, own in content.trials.items()},
            merges=[replace(one, **names) for one in content.merges],
            views=[replace(view, **names) for view in content.views],
            settings={"<i>": [("<i>", "<i>", "<i>")]},
        ),
        "",
    )
    Balance(page)
    assert "<i>" not in page and '"<b>' not in page


def test_a_changed_template_reruns_the_report_and_no_other_stage(repository, tmp_path):
    shutil.copytree(repository / "pipeline", tmp_path / "pipeline", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("dvc.yaml", "params.yaml", "constraints.txt"):
        shutil.copy(repository / name, tmp_path)
    before = code_lines(tmp_path)
    (tmp_path / TEMPLATES.relative_to(repository) / "figures.html").write_text("changed")
    assert {line for line, code in code_lines(tmp_path).items() if code != before[line]} == {"report"}


def test_templates_are_installed_with_the_package(repository):
    declared = tomllib.loads((repository / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]
    room = TEMPLATES.parent
    found = {file for pattern in declared["pipeline.report"] for file in room.glob(pattern)}
    assert {file for file in room.rglob("*") if file.is_file() and file.suffix not in (".py", ".pyc")} == found


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
    planned = plan(trials, content.conditions.tried, SETTINGS, EvaluateParameters(), content.film)
    merges = [one.grasps for one in counts if one.source == "synthesized"]
    funnels = [replace(content.funnels[0], object_name=f"first_{index}") for index in range(count)]
    quality = {(one.first, one.second): content.learned.quality["cube", "can"] for one in merges}
    learned = replace(content.learned, quality=quality, samples=merges)
    listed = {
        (source, request.first, request.second): FoldedTable(("trial", "outcome"), [["0", "success"]])
        for request in [*planned.shown, *planned.listed]
        for source in request.listed
    }
    (view,) = content.views
    strips = {(strip.source, strip.failed): strip for strip in view.strips}
    return replace(
        content,
        summary=summarize("tiny", funnels, merges, trials, {}, learned),
        funnels=funnels,
        merges=merges,
        trials=trials,
        views=[
            replace(view, first=one.first, second=one.second, strips=[strips[strip] for strip in one.strips])
            for one in planned.shown
        ],
        trial_tables=listed | {key: rows for key, rows in content.trial_tables.items() if series_of(key[0])},
        counts=counts,
        worst=planned.worst,
        learned=learned,
    )


def test_the_page_of_many_pairs_shows_the_worst_of_them_and_tables_of_all_objects(content):
    many = many_content(content, 2 * MOST_PAIRS)
    page = build_page(many, "")
    check(page, elsewhere=3)
    assert (many.worst[0].first, many.worst[0].source) == ("first_3", "learned")
    shown = {f"first_{index}" for index in range(WORST_PAIRS)}  # the others are equal, so the order decides
    assert set(re.findall(r'class="view" data-pair="(first_\d+)--', page)) == shown
    assert page.count('<table class="heat">') == 1, "only of the few reconstructed pairs"
    tables = embedded(page, "table-data")
    kind, rows = tables["tables"]["objects-learned-first"]
    assert len(rows) == 2 * MOST_PAIRS and rows[0][0] == "first 3"
    assert dict(zip(tables["headers"][kind], rows[0], strict=True))["success"] == percent(0)
    assert len(tables["tables"]["singles-pinch"][1]) == 2 * MOST_PAIRS
    more = build_page(many_content(content, 6 * MOST_PAIRS), "")
    assert len(more) - len(page) < 100 * 4 * MOST_PAIRS, "an object has some letters in a folded table"


def test_trials_of_pairs_that_something_leads_to_are_listed_though_not_drawn():
    def pairs(names: list[str], successes: int) -> list[PairTrials]:
        return [PairTrials(name, "can", 2, successes, 0, 0, 2, 2, {}) for name in names]

    names = [f"a{index}" for index in range(MOST_PAIRS + 1)]
    trials = {"synthesized": pairs(names, 1), "reconstructed": pairs([names[-1], "other"], 2)}
    film = replace(FILM, source="reconstructed", objects=("other", "can"))
    planned = plan(trials, [], SETTINGS, EvaluateParameters(), film)
    assert [request.first for request in planned.shown] == names[:WORST_PAIRS]
    assert [(request.first, request.listed, request.strips) for request in planned.listed] == [
        (names[-1], ("reconstructed",), ()),
        ("other", ("reconstructed",), ()),
    ]
    assert planned.opening is not None and planned.opening.strips == (("reconstructed", False),)
    assert (planned.opening.first, planned.opening.second) == ("other", "can")
    assert plan(trials, [], SETTINGS, EvaluateParameters(), None).opening is None
    assert all(request.strips == (("synthesized", True),) for request in planned.shown)


def test_long_settings_are_shortened(content):
    rows = [(f"objects.o{index}.density", "5", "") for index in range(1000)]
    page = build_page(replace(content, settings={"objects": rows, "run": [("pairs", "x" * 5000, "")]}), "")
    assert "x" * MOST_LETTERS in page and "x" * (MOST_LETTERS + 1) not in page
    assert f"objects.o{MOST_ROWS - 1}." in page and f"objects.o{MOST_ROWS}." not in page


def test_strips_name_the_trial_and_how_to_replay_it(content, page):
    success, failure, *others = content.views[0].strips
    assert [strip.source for strip in others] == ["learned", "learned", "reconstructed", "reconstructed"]
    for strip in content.views[0].strips:  # as pipeline.replay takes it
        assert re.fullmatch(rf"\./dev replay {strip.source}/cube/\w+/\d+", strip.replay), strip.replay
    number = re.match(r"Trial (\d+),", success.title)
    assert number and success.replay.endswith(f"/{number[1]}") and success.replay in page
    assert not success.failed and failure.failed
    assert Image.open(io.BytesIO(success.sheet)).size == (2 * 64, 64 + 24)
    assert success.captions == ["settle", "hold"]


@pytest.mark.slow
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
