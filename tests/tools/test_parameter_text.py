"""Entries in `params.yaml`: added or replaced, and no other byte changed."""

import pytest
import yaml

from pipeline.records.errors import UserError
from tools.parameter_text import own_meshes, with_mesh, without_meshes

MUG = {"file": "data/raw/mug.stl", "unit": "mm", "up": "-y", "scale": 0.5}
BLOCK = """\
# Mine.
styles:
  pinch:
    - cube   # the first

  # held by the palm
  side: []
meshes: {}   # none yet
track:
  experiment:   spaced
  nothing: null
"""
FLOW = """\
styles: {pinch: [cube, plum,], side: [
    a,
    b  # the last
  ]}
meshes: {old: {file: data/raw/old.stl}}
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
    # Every character that was there still is, in order, but for the empty brackets that now hold something.
    kept = iter(after)
    assert all(character in kept for character in text.replace("{}", "").replace("[]", ""))
    assert own_meshes(yaml.safe_load(after))["mug"] == (MUG, styles)
    assert before == (without_meshes(yaml.safe_load(after)) | {"meshes": before["meshes"]})


def test_the_composed_file_gets_only_new_lines(repository):
    text = (repository / "params.yaml").read_text()
    after = with_mesh(text, "mug", MUG, ["pinch"])
    removed = set(text.splitlines()) - set(after.splitlines())
    assert removed <= {"meshes: {}"}
    assert set(after.splitlines()) - set(text.splitlines()) == {
        "  - mug",
        "meshes:",
        "  mug:",
        "    file: data/raw/mug.stl",
        "    unit: mm",
        "    up: -y",
        "    scale: 0.5",
    }


def test_an_entry_is_replaced_in_its_styles():
    once = with_mesh(BLOCK, "mug", MUG, ["pinch"])
    twice = with_mesh(once, "mug", {"file": "data/raw/mug.obj"}, ["pinch"])
    assert yaml.safe_load(twice)["meshes"] == {"mug": {"file": "data/raw/mug.obj"}}
    assert yaml.safe_load(twice)["styles"]["pinch"] == ["cube", "mug"]
    assert yaml.safe_load(with_mesh(twice, "mug", MUG, ["pinch"])) == yaml.safe_load(once)


def test_values_that_yaml_would_misread_are_quoted():
    entry = {"file": "data/raw/a: b #1.stl", "up": "+y"}
    assert yaml.safe_load(with_mesh(BLOCK, "mug", entry, []))["meshes"]["mug"] == entry


def test_a_text_that_cannot_be_added_to_is_refused_with_what_to_write():
    text = "common: &names [cube]\nstyles: {pinch: *names, side: *names}\nmeshes: {}\n"
    with pytest.raises(UserError, match=r"write `mug: \{file: .*\}` under meshes, mug in styles.pinch there"):
        with_mesh(text, "mug", MUG, ["pinch"])
