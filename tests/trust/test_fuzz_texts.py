"""Damaged YAML, JSON and CSV, through every reader of what a user writes or is handed."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given

from pipeline.records.captures import read_capture, read_truth
from pipeline.records.parameters import read_parameters
from pipeline.share.project import WorkingFolder, objects_of
from tests.trust.damage import damaged, edits, examples, valid_or_one_sentence

TAGS = b"family: tag36h11\nsize: 0.06\nconvention: opencv\n"
TAGS += b"tags:\n  0: {position: [0, 0, 0]}\n  1: {position: [1, 0, 0]}\n"
SCENE = b"support_plane: 0.0\nobjects:\n  cube: {position: [0.1, 0.2], box: [0.05, 0.05, 0.05]}\n"
LENS = b"model: PINHOLE\nwidth: 480\nheight: 360\nparameters: [475.0, 475.0, 240.0, 180.0]\n"
CENTRES = b'{"rendered": true, "centres": {"a": [0.0, 0.1, 0.2], "b": [0, 0, 1]}}'


def capture(folder: Path) -> Path:
    """A capture with everything that has text."""
    (folder / "images").mkdir(parents=True)
    (folder / "gt").mkdir()
    (folder / "images/a.png").touch()
    for name, content in (("tags", TAGS), ("scene", SCENE), ("intrinsics", LENS)):
        (folder / f"{name}.yaml").write_bytes(content)
    (folder / "gt/cameras.json").write_bytes(CENTRES)
    return folder


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("texts")


@examples(12)
@given(changes=edits)
def test_params(place, repository, changes):
    source = place / "params.yaml"
    source.write_bytes(damaged((repository / "params.yaml").read_bytes()[:1500], changes))
    valid_or_one_sentence(lambda: read_parameters(source))
    valid_or_one_sentence(lambda: objects_of(WorkingFolder(place)))


@pytest.mark.parametrize("name", ["tags.yaml", "scene.yaml", "intrinsics.yaml", "gt/cameras.json"])
@examples(25)
@given(changes=edits)
def test_captures(place, name, changes):
    folder = place / "capture"
    if not folder.exists():
        capture(folder)
    sound = (folder / name).read_bytes()
    try:
        (folder / name).write_bytes(damaged(sound, changes))
        if not valid_or_one_sentence(lambda: read_capture(folder)):
            valid_or_one_sentence(lambda: read_truth(folder))
    finally:
        (folder / name).write_bytes(sound)
