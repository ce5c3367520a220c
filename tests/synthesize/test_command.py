"""The stage as a command, in a folder of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from pydantic import ValidationError

from pipeline.hand.model import load_hand
from pipeline.hand.moves import finger_joints
from pipeline.records import paths
from pipeline.records.objects import write_prepared_object
from pipeline.records.tables import CANDIDATES, read_table
from pipeline.synthesize import __main__ as stage
from tests.synthesize import shapes
from tests.synthesize.styles import some_style

HAND = load_hand("allegro")
SIDE_POSTURE = np.array(HAND.style("side").posture)
CHAINS = 40


@pytest.fixture
def workplace(empty_folder: Path, repository: Path) -> Path:
    """Two prepared objects and short chains."""
    values = yaml.safe_load((repository / "params.yaml").read_text())
    values["synthesize"]["optimizer"]["polish_iterations"] = 20
    values["synthesize"]["energy"] |= {"object_points": 500, "hand_points": 400}
    for style in ("pinch", "side"):
        values["synthesize"][style] |= {"chains": CHAINS, "iterations": 120}
    values["compute"]["workers"] = 1
    write(empty_folder, values)
    for prepared in (shapes.box("cube"), shapes.cylinder("slender_cylinder")):
        write_prepared_object(paths.prepared_folder(prepared.name), prepared)
    return empty_folder


def write(folder: Path, values: dict) -> None:
    (folder / "params.yaml").write_text(yaml.safe_dump(values))


def run(style: str, name: str) -> int:
    return stage.main(["--style", style, "--object", name])


@pytest.mark.parametrize(("style", "name"), [("pinch", "cube"), ("side", "slender_cylinder")])
def test_every_chain_has_a_row_and_the_bytes_do_not_depend_on_workers(workplace, style, name):
    assert run(style, name) == 0
    target = paths.candidates_file(style, name)
    first = target.read_bytes()
    values = yaml.safe_load((workplace / "params.yaml").read_text())
    values["compute"]["workers"] = 2
    write(workplace, values)
    assert run(style, name) == 0
    assert target.read_bytes() == first

    rows = read_table(target, CANDIDATES, "synthesize")
    assert rows["grasp_id"].tolist() == list(range(CHAINS))
    assert (
        rows["rejected_by"]
        .isin(["", "joints", "distance", "force_closure", "penetration", "table", "self_penetration", "duplicate"])
        .all()
    )
    settings = values["synthesize"][style]
    sets = ["+".join(fingers) for fingers in settings["finger_sets"]]
    assert rows["fingers"].tolist() == [sets[index % len(sets)] for index in range(CHAINS)]
    for row in rows.itertuples():
        assert len(row.contact_candidates) == settings["contacts"][row.fingers] == len(row.contact_points)
        assert {HAND.contact_finger[index] for index in row.contact_candidates} == set(row.fingers.split("+"))
    q = np.stack(rows["q"].tolist())
    assert (q >= HAND.lower).all() and (q <= HAND.upper).all()
    if style == "side":
        held = finger_joints(("thumb", "index", "middle"), HAND)
        assert np.abs(q[:, held] - SIDE_POSTURE[held]).max() < 0.5
    weights = values["synthesize"]["energy"]
    total = (
        weights["weight_force_closure"] * rows["energy_force_closure"]
        + weights["weight_distance"] * rows["energy_distance"]
        + weights["weight_penetration"] * (rows["energy_penetration"] + rows["energy_table"] + rows["energy_keep_out"])
        + weights["weight_self_penetration"] * rows["energy_self_penetration"]
        + weights["weight_joints"] * rows["energy_joints"]
        + settings["weight_offset"] * rows["energy_offset"]
    )
    np.testing.assert_allclose(rows["energy"], total, rtol=1e-9)


def test_another_seed_gives_other_grasps(workplace):
    assert run("pinch", "cube") == 0
    first = read_table(paths.candidates_file("pinch", "cube"), CANDIDATES, "synthesize")
    values = yaml.safe_load((workplace / "params.yaml").read_text())
    values["seed"] += 1
    write(workplace, values)
    assert run("pinch", "cube") == 0
    other = read_table(paths.candidates_file("pinch", "cube"), CANDIDATES, "synthesize")
    assert (np.abs(np.stack(first["q"].tolist()) - np.stack(other["q"].tolist())).max(1) > 0).all()


def test_missing_object_is_one_sentence(workplace, capsys):
    assert run("pinch", "pear") != 0
    message = capsys.readouterr().err.strip()
    assert "pear" in message and "\n" not in message
    assert not paths.candidates_file("pinch", "pear").exists()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"contacts": {"thumb+index": 1}}, "at least 2"),
        ({"contacts": {"index+thumb": 2}}, "thumb\\+index"),
        ({"contacts": {"thumb+index": 2, "index+thumb": 2}}, "another order"),
        ({"finger_sets": [["thumb", "thumb"]], "contacts": {"thumb+thumb": 2}}, "twice"),
        ({"links": {"thumb+middle": ["link_3.0"]}}, "thumb\\+middle"),
        ({"distance_from_palm": [0.2, 0.1]}, "the smaller one first"),
    ],
)
def test_finger_sets_that_cannot_hold_are_refused(changes, message):
    values = {"finger_sets": [["thumb", "index"]], "contacts": {"thumb+index": 2}} | changes
    with pytest.raises(ValidationError, match=message):
        some_style(**values)


def test_a_set_that_is_not_in_use_keeps_its_entries():
    contacts, links = {"thumb+index": 2, "thumb+middle": 2}, {"thumb+middle": ["link_7.0"]}
    assert some_style(finger_sets=[["thumb", "index"]], contacts=contacts, links=links).contacts == contacts
