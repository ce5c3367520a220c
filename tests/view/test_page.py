"""What the page reads, says and shows: with made-up tables in this process, and served for real in another."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from pipeline.hand.model import load_hand
from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.flat import PAIR_GRASPS, PAIR_TRIALS
from pipeline.records.objects import write_prepared_object
from pipeline.records.parameters import read_parameters
from pipeline.records.tables import CANDIDATES, VALIDATED, write_table
from pipeline.report.meanings import VALIDATION
from pipeline.view import browse, facts, scenes
from pipeline.view.choice import turned_to
from pipeline.view.library import Library
from pipeline.view.page import Page
from pipeline.view.tables import (
    CANDIDATES_VIEW,
    MERGED_VIEW,
    OBJECTS,
    RECONSTRUCTIONS,
    TRIALS_VIEW,
    VALIDATED_VIEW,
    VIEWS,
    sponge_height,
)
from tests.browser import needs_chromium, open_page
from tests.pairs import write_pairs
from tests.report import made_up
from tests.view.made_up import box, write_parameters

HAND = load_hand("allegro")


@pytest.fixture
def bare(repository: Path, empty_folder: Path) -> Path:
    """A project in which no stage has run."""
    write_parameters(repository, empty_folder)
    return empty_folder


@pytest.fixture
def project(bare: Path) -> Path:
    """One in which stages have run, but neither those of learned grasps nor those of photos."""
    for name, extents in (("cube", (0.04, 0.04, 0.04)), ("soup_can", (0.06, 0.06, 0.1))):
        write_prepared_object(paths.prepared_folder(name), box(name, extents))
    for style, name in (("pinch", "cube"), ("side", "soup_can")):
        write_table(paths.candidates_file(style, name), made_up.candidates(style, name), CANDIDATES)
        write_table(paths.validated_file(style, name), made_up.validated(style, name), VALIDATED)
    write_pairs(paths.merged_file("cube"), made_up.merged("cube", "soup_can"), PAIR_GRASPS)
    write_pairs(paths.trials_file("synthesized", "cube"), made_up.trials("cube", ["soup_can"]), PAIR_TRIALS)
    write_pairs(paths.series_file("learned-low-sapien"), made_up.trials("cube", ["soup_can"]), PAIR_TRIALS)
    return bare


@pytest.fixture
def page(project: Path):
    """The page of that project."""
    page = Page(lambda: Library(read_parameters(), HAND), "127.0.0.1", 18080)
    yield page
    page.close()


def shown(page: Page, kind: str) -> set[str]:
    return {name.removeprefix(f"/{kind}/") for name in page.canvas.shown if name.startswith(f"/{kind}/")}


def test_every_missing_table_names_the_stage_that_makes_it(bare: Path) -> None:
    library = Library(read_parameters(), HAND)
    said = {view: " ".join(library.index(view)[1]) for view in VIEWS}
    for view, stages in {
        OBJECTS: ["prepare"],
        CANDIDATES_VIEW: ["synthesize@pinch", "synthesize@side"],
        VALIDATED_VIEW: ["validate@pinch", "validate@side"],
        MERGED_VIEW: ["merge", "sample@learned", "sample@reconstructed"],
        TRIALS_VIEW: ["evaluate@synthesized", "evaluate@learned", "evaluate@reconstructed", "evaluate-conditions"],
        RECONSTRUCTIONS: ["reconstruct"],
    }.items():
        assert all(f"run `dvc repro {stage}` to make it" in said[view] for stage in stages), said[view]


def test_stages_that_are_named_exist(bare: Path, repository: Path) -> None:
    import yaml

    stages = set(yaml.safe_load((repository / "dvc.yaml").read_text())["stages"])
    assert {table.stage.split("@")[0] for table in Library(read_parameters(), HAND).tables.values()} <= stages


def test_index_names_every_row(project: Path) -> None:
    library = Library(read_parameters(), HAND)
    validated = library.index(VALIDATED_VIEW)[0]
    assert list(validated["name"][:4]) == [f"validate/pinch/cube/{number}" for number in range(4)]
    assert list(validated["reason"][:4]) == ["passed", "gravity:-x", "distance", "passed"]
    trials = library.index(TRIALS_VIEW)[0].set_index("name")
    assert list(trials.index[:3]) == [f"evaluate/synthesized/cube/soup_can/{number}" for number in range(3)]
    assert list(trials["outcome"][:3]) == ["success", "failure", "failure"]
    assert trials.loc["evaluate/conditions/learned-low-sapien/cube/soup_can/2", "reason"] == "dropped in hold"
    assert sponge_height(library.parameters, "learned-low-sapien") == 0.07
    assert sponge_height(library.parameters, "learned") == 0.1


def test_pairs_share_a_table_and_have_rows_of_their_own(project: Path) -> None:
    pairs = [made_up.merged("cube", "soup_can"), made_up.merged("cube", "mug", accepted=3)]
    write_pairs(paths.merged_file("cube"), pd.concat(pairs), PAIR_GRASPS)
    library = Library(read_parameters(), HAND)
    index = library.index(MERGED_VIEW)[0].set_index("name", drop=False)
    assert list(index["second"]) == ["soup_can"] * 3 + ["mug"] * 4
    row = library.row(index.loc["merge/cube/mug/2"])
    assert (row["object1"], row["merged_id"]) == ("mug", 2)
    np.testing.assert_array_equal(row["q"], np.full(16, 0.2))


def test_tables_are_read_again_when_they_change_and_only_then(project: Path) -> None:
    library = Library(read_parameters(), HAND)
    line = library.index(MERGED_VIEW)[0].iloc[2]
    assert library.index(MERGED_VIEW)[0].equals(library.index(MERGED_VIEW)[0])
    first = library._once("index", paths.merged_file("cube"), lambda: pytest.fail("was not kept"))
    assert len(first) == 3
    write_pairs(paths.merged_file("cube"), made_up.merged("cube", "soup_can", accepted=1), PAIR_GRASPS)
    assert len(library.index(MERGED_VIEW)[0]) == 2
    with pytest.raises(UserError, match="row 2"):
        library.row(line)


def test_a_damaged_table_is_a_sentence_beside_the_others(project: Path) -> None:
    paths.candidates_file("pinch", "cube").write_bytes(b"PAR1 and nothing more")
    index, sentences = Library(read_parameters(), HAND).index(CANDIDATES_VIEW)
    assert set(index["first"]) == {"soup_can"}
    assert len(sentences) == 1 and "damaged" in sentences[0] and "`dvc repro synthesize@pinch`" in sentences[0]


def test_page_begins_with_the_objects_and_leads_through_every_view(page: Page) -> None:
    panel = page.panel
    assert {"object/cube", "object/soup_can", "part/cube/01"} <= shown(page, "solid")
    assert not panel.notice.visible and panel.view.value == OBJECTS
    page.act(lambda: turned_to(VALIDATED_VIEW))
    assert panel.legend.content.count(": 4<") == 1  # passed; distance: 2, gravity: 2
    assert shown(page, "label") == {f"{number:03d}" for number in range(8)}
    page.act(lambda: page.choice.filtered("reason", "gravity:-x"))
    assert panel.heading.content.startswith("rows 1 to 2 of 2")
    assert list(panel.filters["style"].options) == ["all (2)", "pinch (1)", "side (1)"]
    page.act(lambda: page.choice.filtered("style", "side"))
    assert panel.heading.content.startswith("rows 1 to 1 of 1") and "object/cube" not in shown(page, "solid")

    page.go_to("validate/pinch/cube/1")
    assert panel.heading.content == "**validate/pinch/cube/1** (2 of 4)" and "gravity:-x" in panel.text.content
    assert shown(page, "cloud") == {"contacts"} and panel.layers["contacts"].visible
    page.act(lambda: page.stepped(1))
    assert panel.heading.content == "**validate/pinch/cube/2** (3 of 4)"
    page.act(lambda: page.stepped(-3))
    assert panel.heading.content == "**validate/pinch/cube/3** (4 of 4)"

    page.go_to("merge/cube/soup_can")
    assert panel.heading.content.startswith("rows 1 to 3 of 3") and shown(page, "label") == {"000", "001", "002"}
    page.go_to("merge/cube/soup_can/0")
    assert panel.heading.content == "**merge/cube/soup_can/0** (1 of 3)"
    assert {"object0/cube", "object1/soup_can"} <= shown(page, "solid")
    assert page.related_links == {"pinch": "validate/pinch/cube/0", "side": "validate/side/soup_can/0"}
    assert panel.notice.visible is False or "sample" in panel.notice.content

    page.go_to("synthesized/cube/soup_can/1")
    assert "plan second" in panel.text.content and "`./dev replay synthesized/cube/soup_can/1`" in panel.text.content
    assert [option.split(". ")[1] for option in panel.moment.options] == ["settle", "close first"]
    assert page.related_links == {"its grasp": "merge/cube/soup_can/1"}
    assert "object0/cube" in shown(page, "solid") and not shown(page, "label")


def test_page_says_what_it_cannot_show_and_stays(page: Page) -> None:
    page.act(lambda: turned_to(RECONSTRUCTIONS))
    assert "run `dvc repro reconstruct`" in page.panel.notice.content and not page.canvas.shown
    page.go_to("merge/cube/soup_can/9")
    assert "there is no row" in page.panel.notice.content
    paths.prepared_folder("cube").joinpath("object.json").unlink()
    page.go_to("merge/cube/soup_can/0")
    assert "run `dvc repro prepare`" in page.panel.notice.content and page.panel.notice.visible


def test_a_click_leads_to_the_row(page: Page) -> None:
    page.act(lambda: turned_to(CANDIDATES_VIEW))
    where = page.drawing.cells[6]
    page._click(SimpleNamespace(ray_origin=tuple(where + [0, -1, 1]), ray_direction=(0, 1, -1)))
    assert page.choice.arrangement == scenes.ONE and "synthesize/side/soup_can/2" in page.panel.heading.content


def test_moving_on_sends_no_mesh_again(page: Page) -> None:
    page.go_to("merge/cube/soup_can/0")
    before = {name: handle for name, (_, handle) in page.canvas.shown.items()}
    page.act(lambda: page.stepped(1))
    assert {name: handle for name, (_, handle) in page.canvas.shown.items()} == before
    tip = page.canvas.shown["/solid/hand/05"]
    np.testing.assert_allclose(tip[1].batched_positions, tip[0].T_world[:, :3, 3], atol=1e-6)


def test_numbers_are_in_the_units_that_they_name() -> None:
    row = {"rejected_by": "table:drift", "fingers": "thumb+index", "energy": 0.25, "table_drift": 0.0234}
    shown = facts.grasp_facts(row | {"gravity_drift": np.array([0.001, 0.0123])})
    assert VALIDATION["table:drift"] in shown
    assert "| table drift | 23.40 mm |" in shown and "| energy | 0.250 |" in shown
    assert "| worst gravity drift | 12.30 mm |" in shown
    assert facts.replay_command("evaluate/conditions/learned-low-sapien/cube/can/2") == (
        "./dev replay learned-low-sapien/cube/can/2"
    )


def test_server_starts_where_no_stage_has_run(bare: Path, repository: Path) -> None:
    """As a user starts it; a browser's first steps are made: the page over HTTP, then the scene over a websocket."""
    environment = os.environ | {"PYTHONPATH": str(repository)}
    command = [sys.executable, "-m", "pipeline.view.browse", "--port", "18090"]
    server = subprocess.Popen(
        command,
        cwd=bare,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # Tests that run in the background of a shell are deaf to Ctrl-C, and would pass this on.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    try:
        address = server.stdout.readline().split()[0]
        with urllib.request.urlopen(address, timeout=30) as answer:
            assert answer.status == 200 and b"<html" in answer.read().lower()
        assert b"dvc repro prepare`" in first_text(address)
    finally:
        server.send_signal(signal.SIGINT)
        _, errors = server.communicate(timeout=60)
    assert server.returncode == 0 and not errors


def first_text(address: str) -> bytes:
    """The text of what the server sends first: a header of two lengths, compressed messages, then raw arrays."""
    import viser
    import zstandard
    from websockets.sync.client import connect

    url = address.replace("http://", "ws://")
    with connect(url, subprotocols=[f"viser-v{viser.__version__}"], max_size=None) as socket:
        message = socket.recv(timeout=30)
    length = int.from_bytes(message[8:16], "little")
    return zstandard.ZstdDecompressor().decompress(message[16 : 16 + length])


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["merge/cube/soup_can/3"], "`dvc repro merge`"),
        (["nonsense"], "nonsense"),
        (["--host", "203.0.113.1"], "203.0.113.1"),
    ],
)
def test_command_says_in_one_sentence_why_not(bare: Path, capsys, arguments: list[str], named: str) -> None:
    assert browse.main(arguments) == 2
    errors = capsys.readouterr().err
    assert errors.startswith("view: ") and named in errors and errors.count("\n") == 1


def test_wrong_port_is_refused(capsys) -> None:
    with pytest.raises(SystemExit):
        browse.main(["--port", "0"])
    assert "--port must be 1 to 65535" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.render
@needs_chromium
def test_browser_shows_a_merged_grasp_without_a_network(page: Page, tmp_path: Path) -> None:
    page.go_to("merge/cube/soup_can/0")
    seen = open_page(
        "http://127.0.0.1:18080",
        width=1000,
        height=700,
        screenshot=tmp_path / "view.png",
        ready="document.body.innerText.includes('merge/cube/soup_can/0')",
    )
    assert seen.console_errors == [] and seen.failed_requests == []
    words = " ".join(seen.text.split())
    assert "passed all checks" in words and "held by thumb + index, then ring + palm" in words
    scene = np.asarray(Image.open(tmp_path / "view.png").convert("RGB"), float)[200:, :670]  # beside the panel
    assert (scene.min(axis=2) < 240).mean() > 0.15, "hand and objects fill a good part of an otherwise white scene"
