"""Entries in `params.yaml`: added or replaced, with the user's comments, order and quotes kept."""

import re

import pytest
import yaml

from pipeline.records.errors import UserError
from tools.parameter_text import own_meshes, with_mesh, without_meshes

MUG = {"file": "data/raw/a: b #1.stl", "unit": "mm", "up": "-y", "scale": 1e-05}  # what YAML could misread
BLOCK = """\
# Mine.
styles:
    pinch:
      - cube   # the first

    # held by the palm
    side: []
meshes: {}   # none yet
# about track
track:
    experiment:   'spaced'
    nothing: null
"""
FLOW = """\
styles: {pinch: [cube, plum,], side: [
    a,
    b  # the last
  ]}
meshes: {old: {file: "data/raw/old.stl"}}
"""
LAST = """\
styles:
  pinch:
  - a
  side:
  - a
meshes:
  old:
    file: x
    # about the file
    unit: m # metre

"""


@pytest.mark.parametrize("text", [BLOCK, FLOW, LAST, LAST.rstrip()])
@pytest.mark.parametrize("styles", [["pinch"], ["pinch", "side"]])
def test_nothing_but_the_entries_changes(text, styles):
    before, after = yaml.safe_load(text), with_mesh(text, "mug", MUG, styles)
    expected = yaml.safe_load(text)
    expected["meshes"]["mug"] = MUG
    for style in styles:
        expected["styles"][style].append("mug")
    assert yaml.safe_load(after) == expected
    # Every character that was there still is, in order, but for spaces and what brackets need.
    kept = iter(after)
    assert all(character in kept for character in re.sub(r"\{\}|\[\]|,\]|\s", "", text))
    assert own_meshes(yaml.safe_load(after))["mug"] == (MUG, styles)
    assert before == (without_meshes(yaml.safe_load(after)) | {"meshes": before["meshes"]})


def test_comments_stay_with_what_they_stand_above_or_beside():
    lines = [line.strip() for line in with_mesh(BLOCK, "mug", MUG, ["pinch"]).splitlines()]
    assert lines[lines.index("# held by the palm") + 1] == "side: []"
    assert lines[lines.index("# about track") + 1] == "track:"
    assert lines[lines.index("- cube   # the first") + 1] == "- mug"


def test_the_composed_file_gets_only_new_lines(repository):
    text = (repository / "params.yaml").read_text()
    after = with_mesh(text, "mug", {"file": "data/raw/mug.stl", "up": "-y"}, ["pinch"])
    assert set(text.splitlines()) - set(after.splitlines()) <= {"meshes: {}"}
    assert set(after.splitlines()) - set(text.splitlines()) == {
        "  - mug",
        "meshes:",
        "  mug:",
        "    file: data/raw/mug.stl",
        "    up: -y",
    }


def test_an_entry_is_replaced_in_its_styles():
    once = with_mesh(BLOCK, "mug", MUG, ["pinch"])
    twice = with_mesh(once, "mug", {"file": "data/raw/mug.obj"}, ["pinch"])
    assert yaml.safe_load(twice)["meshes"] == {"mug": {"file": "data/raw/mug.obj"}}
    assert yaml.safe_load(twice)["styles"]["pinch"] == ["cube", "mug"]
    assert with_mesh(twice, "mug", MUG, ["pinch"]) == once


@pytest.mark.parametrize(
    "text",
    [
        "common: &names [cube]\nstyles: {pinch: *names, side: *names}\nmeshes: {}\n",
        "styles: {pinch: [], side: []}\nmeshes: {}\nmeshes: {}\n",
    ],
)
def test_a_text_that_cannot_be_extended_is_refused_with_what_to_write(text):
    with pytest.raises(UserError, match=r"`mug: \{file: .*\}` under meshes, mug in styles.pinch"):
        with_mesh(text, "mug", MUG, ["pinch"])
